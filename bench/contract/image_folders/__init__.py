"""Folders of images with cameras, as other programs write them, to views and back."""
