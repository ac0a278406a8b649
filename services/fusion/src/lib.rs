//! Fusion: who is in this frame, who is late.
