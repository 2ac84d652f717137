"""The slide as the camera sees it: tracks, their noise, and where frames should lie."""
