"""What a deformation should keep, and where it should lead."""
