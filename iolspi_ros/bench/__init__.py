"""What `iolspi bench` measures: what is learned, how fast, and how far it grows."""
