"""The virtual cohort: sampled heads, deformities and scans."""
