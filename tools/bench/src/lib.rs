//! Latency and soak measurements of the running system.
