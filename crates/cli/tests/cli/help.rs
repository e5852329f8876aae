//! Help, usage errors, completions.

use crate::program::Place;

/// Every command, as it is typed.
const COMMANDS: [&str; 27] = [
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
    "evaluate",
    "reconstruct",
    "refine",
    "frames",
    "weights info",
    "weights convert",
    "weights random",
    "train run",
    "train resume",
    "train presets",
    "presets",
    "config show",
    "doctor",
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
    place.run("--threads 5000000 dem info x.tif").refused("for each core", "--help");
    place.run("--threads 0 dem info x.tif").refused("invalid value '0' for '--threads <N>'", "--help");
}

#[test]
fn completions_name_every_first_word() {
    let place = Place::new();
    for shell in ["bash", "zsh", "fish"] {
        let script = place.run(&format!("completions {shell}")).ok();
        for word in ["hillshade", "polar-real", "from-scratch"] {
            assert!(script.stdout.contains(word), "{shell}: {word}");
        }
    }
}

#[test]
fn verbose_tells_settings_machine_and_times_and_leaves_data_alone() {
    let place = crate::campaign::with_terrain();
    let line = "render terrain --lat-deg -90 --lon-deg 0 --altitude-m 3000 --width 16 --height 16 --json --threads 2";
    let plain = place.run(&format!("{line} --out one")).ok();
    let told = place.run(&format!("{line} --out two -v")).ok();
    assert_eq!(told.stdout, plain.stdout);
    for words in
        ["instruction set: ", "threads: 2", "width: 16", "time: truth ", "time: radiance ", "time: total "]
    {
        assert!(told.stderr.contains(words), "{words}: {}", told.stderr);
        assert!(!plain.stderr.contains(words), "{words}: {}", plain.stderr);
    }
    let told = place.run("plan tiny.toml --terrain terrain --out plan.csv --verbose").ok();
    assert!(
        told.stderr.contains("altitude_levels_m") && told.stderr.contains("time: plan "),
        "{}",
        told.stderr
    );
    place.run("presets -v -q").refused("cannot be used with", "usage");
}
