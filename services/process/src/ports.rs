//! What publishers and subscribers have in common: how a header becomes an iceoryx2 user header, and
//! why a port could not do its work.

use bytemuck::Pod;
use iceoryx2::prelude::ZeroCopySend;
use protocol::wire::Header;

/// How processes share memory, with ports that may go to another thread: the bridge receives and sends
/// on those of zenoh. Same layout as `ipc`: what is read from elsewhere may use that.
pub(crate) type Ipc = iceoryx2::prelude::ipc_threadsafe::Service;

/// A number that a payload may consist of.
pub trait Element: Pod + ZeroCopySend + std::fmt::Debug + Default {}
impl Element for u8 {}
impl Element for u64 {}
impl Element for f32 {}

/// A header of ours as iceoryx2 carries it.
#[derive(Debug, Default, Clone, Copy)]
#[repr(transparent)]
pub(crate) struct Wire<H>(pub(crate) H);

// SAFETY: `H: Header` is `Pod`: fixed layout, no padding, no pointer, any bit pattern is a value, and
// `Wire` is transparent over it. So it means the same in every process that maps it, needs no drop,
// and bytes written by anybody are a valid value. The name is the versioned one of the vocabulary.
unsafe impl<H: Header> ZeroCopySend for Wire<H> {
    unsafe fn type_name() -> &'static str {
        H::TYPE_NAME
    }
}

/// Why a process cannot use shared memory.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The instance has no living owner.
    #[error(
        "no supervisor runs the site {site} in {run_dir}: start it with `tog run` (services are \
         started by it, not by hand)"
    )]
    NoOwner {
        /// The site's name.
        site: String,
        /// The run directory.
        run_dir: String,
    },
    /// The site has no such topic.
    #[error("the site has no topic {topic}: its plan and this process disagree")]
    UnknownTopic {
        /// The topic.
        topic: String,
    },
    /// Something could not be opened, after retries.
    #[error("cannot open {what} of {topic} in shared memory: {reason}")]
    Open {
        /// Node, service, publisher, ...
        what: &'static str,
        /// The topic.
        topic: String,
        /// iceoryx2's words.
        reason: String,
    },
    /// A message is larger than the topic allows.
    #[error("a message of {found} elements on {topic}, at most {expected} are possible")]
    TooLarge {
        /// The topic.
        topic: String,
        /// Elements asked for.
        found: usize,
        /// Elements that fit.
        expected: usize,
    },
    /// A lossless publisher sends without credit.
    #[error("no credit on {topic}: ask may_send() before loan()")]
    NoCredit {
        /// The topic.
        topic: String,
    },
    /// A port failed for good.
    #[error("cannot {action} on {topic}: {reason}")]
    Port {
        /// Loan, receive.
        action: &'static str,
        /// The topic.
        topic: String,
        /// iceoryx2's words.
        reason: String,
    },
    /// The system.
    #[error("cannot {action}: {source}")]
    System {
        /// What was tried.
        action: &'static str,
        /// What the system says.
        source: std::io::Error,
    },
    /// The run directory.
    #[error(transparent)]
    Instance(#[from] crate::instance::InstanceError),
}
