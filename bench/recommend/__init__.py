"""Which method serves a scan whose true surface nobody knows: candidates, trials on halves, evidence, ranks."""
