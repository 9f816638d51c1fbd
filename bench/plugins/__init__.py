"""How a plugin is declared, found and configured."""
