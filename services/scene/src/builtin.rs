//! The scenes that are part of the program.

use crate::error::SceneError;
use crate::file::Scene;

/// Name and text of every built-in scene; the files are `deploy/scenes/<name>.toml`.
pub const BUILTIN: [(&str, &str); 4] = [
    ("foyer", include_str!("../../../deploy/scenes/foyer.toml")),
    ("paper-foyer", include_str!("../../../deploy/scenes/paper-foyer.toml")),
    ("paper-room", include_str!("../../../deploy/scenes/paper-room.toml")),
    ("room", include_str!("../../../deploy/scenes/room.toml")),
];

impl Scene {
    /// A built-in scene, by its name in [`BUILTIN`].
    ///
    /// # Errors
    /// If there is none of that name; the message lists those that are.
    pub fn builtin(name: &str) -> Result<Self, SceneError> {
        let Some((_, text)) = BUILTIN.iter().find(|(known, _)| *known == name) else {
            let known = BUILTIN.iter().map(|(known, _)| (*known).to_owned()).collect();
            return Err(SceneError::Unknown { name: name.to_owned(), known });
        };
        Self::parse(text, name)
    }
}
