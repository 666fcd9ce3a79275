"""The energy of the tissue: linear tetrahedra, their patches and tangents."""
