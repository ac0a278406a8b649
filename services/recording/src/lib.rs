//! Reads and writes recordings: MCAP and ROS 1 bags.
