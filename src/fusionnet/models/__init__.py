"""Networks, built from heads, backbones and fusers that plug in; checkpoints are safetensors."""
