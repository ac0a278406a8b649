//! Writes workloads and scenes with their truth.
