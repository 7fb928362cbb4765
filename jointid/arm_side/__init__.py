"""Stiffness of each joint from a sensor behind its gear and the robot's rigid model."""
