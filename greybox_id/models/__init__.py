"""What we know of vehicles: models and the effects they may lack. Models hold no data and no solver."""
