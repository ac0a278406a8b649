//! The imagined building: walls, doors, walkers and the rays that see them.
