"""Pictures of results: the shapes of a case, their errors and colours, figures of them, and plots of scores."""
