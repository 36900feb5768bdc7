"""This station among several: which one leads, what happens when it is silent; a service over its own."""
