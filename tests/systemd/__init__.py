"""The unit, its companions and the package, as far as they show without a machine of their own."""
