"""Where stability is lost: critical speeds and loads, Floquet multipliers, tongues of resonance."""
