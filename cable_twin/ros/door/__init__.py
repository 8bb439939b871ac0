"""Door to a plant without ROS: tags of OPC UA servers and MQTT brokers as topics of a plant, and estimates back."""
