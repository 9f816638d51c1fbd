"""Where the weights of learned methods come from, and what they are trained on."""
