"""What a network is given of a cloud, where it is asked, and what is made of its answers."""
