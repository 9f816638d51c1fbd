"""The choice of a method for a scan without ground truth: candidates, trials on halves, evidence, ranks."""
