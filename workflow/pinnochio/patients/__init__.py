"""One new patient: what is read, what predicts it, what is certified and handed over."""
