"""Clouds filtered by filtering their images."""
