//! The temporal occupancy grid of an area, its collapsed map and its checkpoint.
