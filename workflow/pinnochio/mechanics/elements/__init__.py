"""The energy of the tissue: linear tetrahedra, their patches, tangents, and elements with a pressure."""
