"""Triangles, closest points, closed surfaces, distances and rigid motions, in millimetres; knows no patient."""
