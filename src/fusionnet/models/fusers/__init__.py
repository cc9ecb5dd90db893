"""Fusers: one way of bringing together what was seen and what was said a file.

- `tree_executor`: carries the tree out, entity by entity, on the soft layout that was seen
"""
