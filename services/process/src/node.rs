//! The iceoryx2 node of a process, and the configuration that all nodes of an instance share.

use crate::instance::Instance;
use crate::ports::Ipc;
use iceoryx2::prelude::{Config, FilePath, Node, NodeBuilder, SemanticString, SignalHandlingMode};

/// A node of ours: signals are our business, and so is sweeping up.
pub(crate) fn create_node(instance: &Instance) -> Result<Node<Ipc>, String> {
    let path = instance.iceoryx_config();
    let path = FilePath::new(path.as_os_str().as_encoded_bytes())
        .map_err(|error| format!("{}: {error:?}", path.display()))?;
    // The process-wide configuration must be the instance's: iceoryx2 falls back to it when it sweeps
    // up a node whose own record is gone. The first call of a process decides.
    let reason = |error| format!("configuration {path}: {error:?}");
    Config::setup_global_config_from_file(&path).map_err(reason)?;
    let config = Config::from_file(&path).map_err(reason)?;
    NodeBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .config(&config)
        .create::<Ipc>()
        .map_err(|error| error.to_string())
}

/// The configuration file of an instance: its own root and prefix, and no sweeping but by the owner.
pub(crate) fn iceoryx_config_text(instance: &Instance) -> String {
    #[derive(serde::Serialize)]
    struct Text {
        global: Global,
    }
    #[derive(serde::Serialize)]
    #[serde(rename_all = "kebab-case")]
    struct Global {
        root_path: String,
        prefix: String,
        service: Service,
        node: NodePart,
    }
    #[derive(serde::Serialize)]
    #[serde(rename_all = "kebab-case")]
    struct Service {
        cleanup_dead_nodes_on_open: bool,
    }
    #[derive(serde::Serialize)]
    #[serde(rename_all = "kebab-case")]
    struct NodePart {
        cleanup_dead_nodes_on_creation: bool,
        cleanup_dead_nodes_on_destruction: bool,
    }
    let global = Global {
        root_path: instance.iceoryx_root().display().to_string(),
        prefix: instance.prefix.clone(),
        service: Service { cleanup_dead_nodes_on_open: false },
        node: NodePart {
            cleanup_dead_nodes_on_creation: false,
            cleanup_dead_nodes_on_destruction: false,
        },
    };
    toml::to_string(&Text { global }).unwrap_or_default()
}
