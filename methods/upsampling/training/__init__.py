"""The training of the upsampling networks."""
