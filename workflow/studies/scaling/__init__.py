"""What a finer mesh costs, stage by stage."""
