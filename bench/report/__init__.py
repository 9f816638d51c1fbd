"""How results are printed: terminal, Markdown, LaTeX, CSV."""
