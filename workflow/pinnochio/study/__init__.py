"""A study: its configuration, cases, folds and methods, as the workflow asks for them."""
