"""What rule files ask of the study beside what all of them ask: a module for each, named after it."""
