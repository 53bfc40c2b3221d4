"""The job, stage by stage."""
