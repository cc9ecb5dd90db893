"""The Pick and Place dataset: layouts to learn from, and the pictures rendered of them."""
