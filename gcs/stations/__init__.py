"""What stations of a site send each other and know of each other, and the terms of the lead; pure."""
