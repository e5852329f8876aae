//! Help, usage errors, completions.

use crate::program::Place;

/// Every command, as it is typed.
const COMMANDS: [&str; 16] = [
    "demo",
    "dem info",
    "dem import",
    "dem synth",
    "dem hillshade",
    "render",
    "plan",
    "generate",
    "data check",
    "data sheet",
    "data split",
    "data import",
    "data export",
    "presets",
    "config show",
    "completions",
];

#[test]
fn every_command_has_help_with_one_example_of_itself() {
    let place = Place::new();
    for command in COMMANDS {
        let help = place.run(&format!("{command} --help")).ok();
        let examples: Vec<&str> =
            help.stdout.lines().skip_while(|line| *line != "Example:").skip(1).collect();
        assert_eq!(examples.len(), 1, "{command}: {}", help.stdout);
        assert!(examples[0].trim().starts_with(&format!("selenograph {command}")), "{}", examples[0]);
        assert!(help.stderr.is_empty());
    }
}

#[test]
fn the_front_page_lists_the_commands_and_the_exit_codes() {
    let help = Place::new().run("--help").ok();
    for command in COMMANDS {
        let first = command.split(' ').next().unwrap();
        assert!(help.stdout.lines().any(|line| line.trim_start().starts_with(first)), "{first}");
    }
    assert!(help.stdout.contains("Exit codes: 0 done, 1 wrong input"));
}

#[test]
fn version_is_data() {
    let version = Place::new().run("--version").ok();
    assert_eq!(version.stdout.trim(), concat!("selenograph ", env!("CARGO_PKG_VERSION")));
}

#[test]
fn usage_errors_are_one_line_with_a_hint() {
    let place = Place::new();
    place.run("dem inof x.tif").refused("unrecognized subcommand 'inof'", "'info'");
    place.run("dem info").refused("required arguments were not provided", "usage: selenograph dem info");
    place.run("dem info x.tif --jsn").refused("unexpected argument '--jsn'", "--json");
    place.run("--threads 0 dem info x.tif").refused("invalid value '0' for '--threads <N>'", "--help");
}

#[test]
fn completions_name_every_first_word() {
    let place = Place::new();
    for shell in ["bash", "zsh", "fish"] {
        let script = place.run(&format!("completions {shell}")).ok();
        assert!(script.stdout.contains("hillshade"), "{shell}");
    }
}
