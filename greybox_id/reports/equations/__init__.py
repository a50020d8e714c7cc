"""A model's equations as typeset mathematics, made from the model itself."""
