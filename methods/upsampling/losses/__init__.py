"""What learned upsampling is measured by while it learns."""
