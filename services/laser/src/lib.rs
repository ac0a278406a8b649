//! Laser acquisition: one process per laser.
