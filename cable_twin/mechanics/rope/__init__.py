"""The rope alone: its element, what that is made of, and places on it."""
