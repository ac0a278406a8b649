//! The paper, pure: from scan to collapsed map.
