"""Networks that predict the signed distance of a query from points around it."""
