"""From what users bring to labels, surfaces and registered scans, checked and repaired."""
