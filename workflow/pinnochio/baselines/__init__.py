"""The systems that PINNOCHIO is compared with: networks on the skin and the bone surface, and two linear floors."""
