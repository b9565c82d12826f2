"""What planners work with: what they see, where drones can go, and the best plan of one drone."""
