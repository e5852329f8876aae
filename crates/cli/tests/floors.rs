//! The house rules that no compiler checks: dependencies point down, files stay readable, names keep their meaning.
#![allow(clippy::unwrap_used, reason = "tests may stop")]

use std::path::{Path, PathBuf};
use std::process::Command;

/// Floor of each crate: it may depend only on lower ones (`ARCHITECTURE.md`). A crate that is not listed fails the test.
const FLOORS: [(&str, u32); 16] = [
    ("selenograph-files", 0),
    ("selenograph-geometry", 0),
    ("selenograph-raster", 1),
    ("selenograph-pose", 1),
    ("selenograph-terrain", 2),
    ("selenograph-report", 2),
    ("selenograph-render", 3),
    ("selenograph-network", 3),
    ("selenograph-engine", 4),
    ("selenograph-dataset", 4),
    ("selenograph-reconstruct", 4),
    ("selenograph-model", 4),
    ("selenograph-predict", 5),
    ("selenograph-train", 5),
    ("selenograph-evaluate", 6),
    ("selenograph-cli", 7),
];

/// Longest file, tests included: beyond it a module has two subjects.
const MAX_LINES: usize = 600;

/// Identifiers whose meaning differs from reader to reader, and what to write instead.
const BANNED_IDENTIFIERS: [(&str, &str); 5] = [
    ("c2w", "world_from_cam"),
    ("w2c", "cam_from_world"),
    ("depth", "depth_z or range"),
    ("extrinsics", "world_from_cam"),
    ("Rt", "world_from_cam"),
];

/// Module names that say nothing about what is inside.
const BANNED_MODULES: [&str; 4] = ["utils", "common", "helpers", "types"];

fn workspace_root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

fn floor_of(name: &str) -> Option<u32> {
    FLOORS.iter().find(|(crate_name, _)| *crate_name == name).map(|(_, floor)| *floor)
}

fn rust_files(dir: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(dir) else { return };
    for entry in entries {
        let path = entry.unwrap().path();
        if path.is_dir() {
            if path.file_name().is_some_and(|name| name != "target") {
                rust_files(&path, found);
            }
        } else if path.extension().is_some_and(|ext| ext == "rs") {
            found.push(path);
        }
    }
}

fn all_rust_files() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for folder in ["crates", "examples", "benches"] {
        rust_files(&workspace_root().join(folder), &mut found);
    }
    assert!(found.len() > 10, "the sources were not found");
    found.sort();
    found
}

fn relative(path: &Path) -> String {
    path.strip_prefix(workspace_root()).unwrap().display().to_string()
}

/// The text with comments, strings and character literals blanked out.
fn code_only(text: &str) -> String {
    let bytes: Vec<char> = text.chars().collect();
    let mut out = String::with_capacity(text.len());
    let mut i = 0;
    while i < bytes.len() {
        let rest = &bytes[i..];
        let skip = match rest {
            ['/', '/', ..] => rest.iter().position(|c| *c == '\n').unwrap_or(rest.len()),
            ['/', '*', ..] => block_comment(rest),
            ['"', ..] => quoted(rest, 0),
            ['r', '"' | '#', ..] if !out.ends_with(|c: char| c.is_alphanumeric() || c == '_') => {
                raw_string(rest)
            }
            ['\'', '\\', ..] => 2 + rest[2..].iter().skip(1).position(|c| *c == '\'').map_or(0, |n| n + 2),
            ['\'', _, '\'', ..] => 3,
            _ => 0,
        };
        if skip == 0 {
            out.push(bytes[i]);
            i += 1;
        } else {
            // Line numbers must survive a comment or a string of several lines.
            out.extend(rest[..skip].iter().filter(|c| **c == '\n'));
            out.push(' ');
            i += skip;
        }
    }
    out
}

fn block_comment(rest: &[char]) -> usize {
    let (mut level, mut i) = (0usize, 0);
    while i < rest.len() {
        match &rest[i..] {
            ['/', '*', ..] => {
                level += 1;
                i += 2;
            }
            ['*', '/', ..] => {
                level -= 1;
                i += 2;
            }
            _ => i += 1,
        }
        if level == 0 {
            break;
        }
    }
    i
}

fn quoted(rest: &[char], start: usize) -> usize {
    let mut i = start + 1;
    while i < rest.len() && rest[i] != '"' {
        i += if rest[i] == '\\' { 2 } else { 1 };
    }
    (i + 1).min(rest.len())
}

/// Length of `r#"…"#`; 0 where it is something else (`r#type`, an identifier that begins with r).
fn raw_string(rest: &[char]) -> usize {
    let hashes = rest[1..].iter().take_while(|c| **c == '#').count();
    if rest.get(1 + hashes) != Some(&'"') {
        return 0;
    }
    let mut i = 2 + hashes;
    while i < rest.len() {
        if rest[i] == '"' && rest[i + 1..].iter().take_while(|c| **c == '#').count() >= hashes {
            return i + 1 + hashes;
        }
        i += 1;
    }
    rest.len()
}

fn identifiers(code: &str) -> impl Iterator<Item = &str> {
    code.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

#[test]
fn dependencies_point_down() {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--format-version", "1", "--offline"])
        .current_dir(workspace_root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let mut breaches = Vec::new();
    for package in metadata["packages"].as_array().unwrap() {
        let name = package["name"].as_str().unwrap();
        let Some(floor) = floor_of(name) else {
            breaches.push(format!("{name} has no floor: add it to FLOORS and ARCHITECTURE.md"));
            continue;
        };
        for dependency in package["dependencies"].as_array().unwrap() {
            let on = dependency["name"].as_str().unwrap();
            if let Some(other) = floor_of(on).filter(|other| *other >= floor) {
                breaches.push(format!("{name} (floor {floor}) depends on {on} (floor {other})"));
            }
        }
    }
    assert!(breaches.is_empty(), "{breaches:#?}");
}

#[test]
fn files_stay_readable() {
    let mut breaches = Vec::new();
    for path in all_rust_files() {
        let lines = std::fs::read_to_string(&path).unwrap().lines().count();
        if lines > MAX_LINES {
            breaches.push(format!("{}: {lines} lines, the limit is {MAX_LINES}", relative(&path)));
        }
        let says_nothing = path
            .iter()
            .filter_map(|part| part.to_str())
            .map(|part| part.trim_end_matches(".rs"))
            .any(|part| BANNED_MODULES.contains(&part));
        if says_nothing && relative(&path).contains("/src/") {
            breaches.push(format!("{}: the module's name says nothing about its subject", relative(&path)));
        }
    }
    assert!(breaches.is_empty(), "{breaches:#?}");
}

#[test]
fn names_keep_their_meaning() {
    let mut breaches = Vec::new();
    for path in all_rust_files().iter().filter(|path| relative(path).contains("/src/")) {
        let code = code_only(&std::fs::read_to_string(path).unwrap());
        for (number, line) in code.lines().enumerate() {
            for word in identifiers(line) {
                if let Some((_, instead)) = BANNED_IDENTIFIERS.iter().find(|(banned, _)| *banned == word) {
                    breaches.push(format!("{}:{}: `{word}`: write {instead}", relative(path), number + 1));
                }
            }
        }
    }
    assert!(breaches.is_empty(), "{breaches:#?}");
}

#[test]
fn nothing_is_left_to_do_in_comments() {
    // Put together here, so that this file does not hold the words it looks for.
    let marks = [["TO", "DO"].concat(), ["FIX", "ME"].concat(), ["XX", "X"].concat()];
    let mut breaches = Vec::new();
    for path in all_rust_files() {
        let text = std::fs::read_to_string(&path).unwrap();
        for (number, line) in text.lines().enumerate() {
            if identifiers(line).any(|word| marks.iter().any(|mark| mark == word)) {
                breaches.push(format!("{}:{}", relative(&path), number + 1));
            }
        }
    }
    assert!(breaches.is_empty(), "{breaches:#?}");
}

#[test]
fn the_reader_of_sources_sees_code_only() {
    let text = "let a = \"depth\"; // depth\nlet b = r#\"depth \" x\"#; /* depth /* c */ d */ let c = '\\''; let 'x' = depth;";
    let code = code_only(text);
    assert_eq!(identifiers(&code).filter(|word| *word == "depth").count(), 1);
    assert!(identifiers("self.range + near_depth").all(|word| word != "depth"));
}
