"""How the progressive network is trained."""
