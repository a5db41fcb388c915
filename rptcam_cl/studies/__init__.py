"""What is found out by rendering: focus, what approximations cost and gain, whether a device computes right."""
