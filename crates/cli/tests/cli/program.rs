//! Runs the binary in a folder of its own.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// An answer of the program.
pub struct Answer {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Answer {
    /// What a program that has ended said.
    pub fn of(output: &Output) -> Self {
        Self {
            code: output.status.code().unwrap_or(-1),
            stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }

    /// The JSON on stdout.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {}", self.stdout))
    }

    /// Asserts success.
    pub fn ok(self) -> Self {
        assert_eq!(self.code, 0, "{}{}", self.stdout, self.stderr);
        self
    }

    /// Asserts a refusal of the input: exit code 1, one error line, one hint.
    pub fn refused(self, says: &str, hints: &str) -> Self {
        let errors: Vec<&str> = self.stderr.lines().filter(|line| line.starts_with("error: ")).collect();
        let hint: Vec<&str> = self.stderr.lines().filter(|line| line.starts_with("hint: ")).collect();
        assert_eq!(self.code, 1, "{}{}", self.stdout, self.stderr);
        assert_eq!((errors.len(), hint.len()), (1, 1), "{}", self.stderr);
        assert!(errors[0].contains(says), "expected `{says}` in {}", errors[0]);
        assert!(hint[0].contains(hints), "expected `{hints}` in {}", hint[0]);
        assert!(self.stdout.is_empty(), "{}", self.stdout);
        self
    }
}

/// A folder that the program runs in.
pub struct Place {
    dir: tempfile::TempDir,
}

impl Place {
    pub fn new() -> Self {
        Self { dir: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        std::fs::write(self.path(name), bytes).unwrap();
        self.path(name)
    }

    /// Runs `selenograph` with words separated by blanks.
    pub fn run(&self, line: &str) -> Answer {
        self.run_args(&line.split_whitespace().collect::<Vec<_>>())
    }

    pub fn run_args(&self, args: &[&str]) -> Answer {
        let mut command = self.command(env!("CARGO_BIN_EXE_selenograph"));
        Answer::of(&command.args(args).output().unwrap())
    }

    /// A program in this folder, away from the settings of whoever runs the tests.
    pub fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.current_dir(self.dir.path());
        for name in ["SELENOGRAPH_SEED", "SELENOGRAPH_THREADS", "SELENOGRAPH_WEIGHTS", "RUST_BACKTRACE"] {
            command.env_remove(name);
        }
        command
    }

    /// Names of everything in the folder, hidden files too.
    pub fn names(&self) -> Vec<String> {
        names(self.dir.path())
    }
}

pub fn names(dir: &Path) -> Vec<String> {
    let mut found: Vec<String> = std::fs::read_dir(dir)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    found.sort();
    found
}
