"""One readable training loop, and what each network trains on."""
