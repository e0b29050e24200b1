//! Metrics: how far two pictures are apart.
