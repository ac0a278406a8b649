//! Why a scene was refused.

use crate::file::SCENE_BYTES_MAX;

/// Why a scene was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// Not TOML, an unknown key, a wrong type.
    #[error("scene `{name}` cannot be read:\n{message}")]
    Syntax {
        /// File or name of the scene.
        name: String,
        /// What and where, with a caret.
        message: String,
    },
    /// Bounds are broken; all of them are listed.
    #[error("scene `{name}` is not possible:\n  {}", problems.join("\n  "))]
    Invalid {
        /// Name of the scene.
        name: String,
        /// What was found, what was expected, where.
        problems: Vec<String>,
    },
    /// No scene of that name.
    #[error("found scene `{name}`, expected {}, or a path of a scene file", known.join(", "))]
    Unknown {
        /// The name.
        name: String,
        /// The built-in scenes.
        known: Vec<String>,
    },
    /// No incident of that id.
    #[error("scene `{scene}` has no incident `{id}`, expected one of: {}", known.join(", "))]
    NoIncident {
        /// Name of the scene.
        scene: String,
        /// The id.
        id: String,
        /// The incidents of the scene.
        known: Vec<String>,
    },
    /// The file is too large.
    #[error("scene `{name}` has {found} bytes, expected at most {SCENE_BYTES_MAX}")]
    TooLarge {
        /// File or name of the scene.
        name: String,
        /// Its bytes.
        found: usize,
    },
}
