"""MAVLink as bytes: framing, codecs, signing, compiled kernels; imports only model."""
