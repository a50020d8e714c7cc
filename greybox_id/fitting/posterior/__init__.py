"""What recordings leave open about a fit's parameters: draws of their posterior, and what follows from them."""
