"""Gateway to a plant without ROS: tags of OPC UA servers and MQTT brokers become ROS topics, estimates go back."""
