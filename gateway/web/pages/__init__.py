"""The pages: made on the server, so that they are there at once and without JavaScript too. A module for each."""
