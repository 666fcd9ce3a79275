"""Trying plans of one patient by hand: what is edited, what is predicted of it, the picture and the page."""
