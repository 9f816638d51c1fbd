"""The methods that we ship, in folders by family. A file is one method or one building block."""
