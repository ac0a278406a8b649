//! The journal of events and its feed.
