"""The web server, the phone page and the desk page."""
