"""Pictures by Matplotlib and PyVista."""
