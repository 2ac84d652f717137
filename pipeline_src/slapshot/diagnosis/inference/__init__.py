"""What follows from whitened residuals and columns; nothing here knows physics."""
