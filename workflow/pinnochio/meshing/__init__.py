"""From label maps to conforming tetrahedra and labelled interfaces."""
