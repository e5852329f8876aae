//! The table of `docs/formats.md` is that of the definitions.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use selenograph_evaluate::pair_metrics::{Better, definitions};
use std::path::Path;

#[test]
fn every_key_is_documented_as_it_is_defined() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/formats.md");
    let text = std::fs::read_to_string(path).unwrap();
    let mut rows = text.lines().filter(|line| line.starts_with("| `"));
    for definition in definitions() {
        let better = match definition.better {
            Better::Up => "↑",
            Better::Down => "↓",
            Better::None => "",
        };
        let row = format!("| `{}` | {} | {better} | {} |", definition.key, definition.unit, definition.text);
        assert!(rows.any(|line| line == row), "missing in docs/formats.md, or out of order:\n{row}");
    }
}
