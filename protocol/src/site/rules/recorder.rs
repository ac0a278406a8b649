//! What must agree within `[recorder]`.

use super::super::diagnostics::Finding;
use super::super::recorder::Recorder;
use super::super::tree::Node;

pub(super) fn check(root: &Node<'_>, findings: &mut Vec<Finding>) {
    let Some(recorder) = root.get("recorder") else { return };
    let Some(keep_mb) = recorder.number("keep_mb") else { return };
    let split_mb = recorder.number_or("split_mb", Recorder::default().split_mb);
    if keep_mb < 2.0 * split_mb {
        let node = recorder.get_or_self("keep_mb");
        let expected = format!("at least {}, twice `split_mb`", 2.0 * split_mb);
        findings.push(
            Finding::error(&node, keep_mb.to_string(), expected)
                .message("a file would be deleted as soon as it is complete")
                .help("the file that is being written counts as well: lower `split_mb`"),
        );
    }
}
