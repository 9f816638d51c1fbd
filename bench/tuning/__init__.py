"""Search good parameters of a method on train shapes, and judge them on others."""
