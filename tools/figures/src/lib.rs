//! Pictures of maps.
