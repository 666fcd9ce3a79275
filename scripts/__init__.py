"""Stage scripts: one per rule, one public function each."""
