//! `train`: killed at any moment, stopped, on a full disk.

use crate::program::{Answer, Place, names};
use crate::train_input::{RUN, with_network};
use std::path::Path;
use std::process::{Child, Stdio};

/// Times that a run is killed while a checkpoint is being written.
const KILLS: usize = 4;
/// Times that it is tried: some come too late, when the checkpoint has its name.
const MAX_TRIES: usize = 24;

fn spawned(place: &Place, line: &str) -> Child {
    let mut command = place.command(env!("CARGO_BIN_EXE_selenograph"));
    command.args(line.split_whitespace()).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap()
}

/// What the steps and validations of a run computed, to the last digit; what the clock says is left out.
fn curve(run: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap();
    let line = |line: &str| {
        let mut record: serde_json::Value = serde_json::from_str(line).unwrap();
        let fields = record.as_object_mut().unwrap();
        for clock in ["pairs_per_s", "data_wait_share", "elapsed_s"] {
            fields.remove(clock);
        }
        record
    };
    text.lines().map(line).collect()
}

fn num_lines(run: &Path) -> usize {
    std::fs::read_to_string(run.join("metrics.jsonl")).map_or(0, |text| text.lines().count())
}

fn last_file(run: &Path, file: &str) -> Vec<u8> {
    let checkpoints = run.join("checkpoints");
    let last = names(&checkpoints).into_iter().rfind(|name| name.starts_with("step-")).unwrap();
    std::fs::read(checkpoints.join(last).join(file)).unwrap()
}

/// Goes on with the run and kills it at the moment when `file` of a checkpoint appears, after `steps` further steps. Whether
/// the checkpoint was then not whole.
fn killed_while_writing(place: &Place, run: &Path, steps: usize, file: &str) -> bool {
    let unfinished = || {
        let entries = std::fs::read_dir(run.join("checkpoints")).into_iter().flatten().flatten();
        entries.map(|entry| entry.path()).find(|path| path.to_string_lossy().ends_with(".partial"))
    };
    // What an earlier kill has left would look like a checkpoint of this sitting.
    unfinished().into_iter().for_each(|left| std::fs::remove_dir_all(left).unwrap());
    let first = num_lines(run);
    let mut child = spawned(place, "train resume broken");
    while num_lines(run) < first + steps || !unfinished().is_some_and(|writing| writing.join(file).exists()) {
        assert!(child.try_wait().unwrap().is_none(), "the run came to its end");
    }
    child.kill().unwrap();
    child.wait().unwrap();
    unfinished().is_some()
}

#[test]
fn a_run_killed_again_and_again_learns_the_same_to_the_last_bit() {
    let place = with_network();
    place.run(&format!("{RUN} --out whole")).ok();
    let run = place.path("broken");
    // Before its first checkpoint: it begins again.
    let mut child = spawned(&place, &format!("{RUN} --out broken"));
    while !run.join("run.toml").exists() {
        assert!(child.try_wait().unwrap().is_none());
    }
    child.kill().unwrap();
    child.wait().unwrap();

    // Its files in the order in which they are written.
    let files = ["", "weights.safetensors", "average.safetensors", "optimizer.safetensors"];
    let mut num_halves = 0;
    for n in 0..MAX_TRIES {
        if num_halves == KILLS {
            break;
        }
        let is_half = killed_while_writing(&place, &run, n % 3, files[num_halves]);
        num_halves += usize::from(is_half);
        eprintln!("killed after {} lines, checkpoint unfinished: {is_half}", num_lines(&run));
    }
    assert_eq!(num_halves, KILLS);
    place.run("train resume broken").ok();

    let (whole, broken) = (curve(&place.path("whole")), curve(&run));
    assert!(whole.iter().any(|record| record["kind"] == "validation"));
    assert_eq!(broken, whole);
    for file in ["weights.safetensors", "average.safetensors", "optimizer.safetensors"] {
        assert!(last_file(&run, file) == last_file(&place.path("whole"), file), "{file}");
    }
    let best = "checkpoints/best.safetensors";
    assert!(std::fs::read(run.join(best)).unwrap() == std::fs::read(place.path("whole").join(best)).unwrap());
    // Nothing is left to do, and nothing is done.
    place.run("train resume broken").ok();
    assert_eq!(curve(&run), whole);
}

#[test]
fn a_run_that_is_stopped_leaves_a_checkpoint_and_goes_on() {
    let place = with_network();
    place.run(&format!("{RUN} --out whole")).ok();
    // No checkpoint but the first and the one that it leaves.
    let line = format!("{RUN} --set learning.checkpoint.every_min=60 --out run");
    for (line, signal) in [(line.as_str(), "INT"), ("train resume run", "TERM")] {
        let first = num_lines(&place.path("run"));
        let mut command = place.command(env!("CARGO_BIN_EXE_selenograph"));
        let command = command.args(line.split_whitespace()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        while num_lines(&place.path("run")) < first + 3 {
            assert!(child.try_wait().unwrap().is_none());
        }
        place
            .run("train resume run --quiet")
            .refused("`run` is in use by `selenograph train run` (process ", "wait for its end");
        let kill = format!("kill -{signal} {}", child.id());
        assert!(place.command("sh").args(["-c", &kill]).status().unwrap().success());
        let answer = Answer::of(&child.wait_with_output().unwrap());
        assert_eq!(answer.code, 0, "{}", answer.stderr);
        assert!(
            answer.stderr.contains("stopped; `selenograph train resume run` goes on"),
            "{}",
            answer.stderr
        );
    }
    place.run("train resume run").ok();
    assert_eq!(curve(&place.path("run")), curve(&place.path("whole")));
}

#[test]
fn a_full_disk_costs_no_checkpoint_that_is_there() {
    let place = with_network();
    place.run(&format!("{RUN} --out whole")).ok();
    // The first checkpoint, whose optimiser knows nothing yet, finds room; those after it do not. 512 bytes a block.
    let size = std::fs::metadata(place.path("network.safetensors")).unwrap().len();
    let program = env!("CARGO_BIN_EXE_selenograph");
    let limited = format!("trap '' XFSZ; ulimit -f {}; exec {program} {RUN} --out run", size * 3 / 2 / 512);
    let answer = Answer::of(&place.command("sh").args(["-c", &limited]).output().unwrap());
    assert!(answer.stderr.contains("optimizer.safetensors"), "{}", answer.stderr);
    assert!(answer.stderr.contains("the checkpoint before is whole"), "{}", answer.stderr);
    assert!(answer.stderr.contains("hint: is there space"), "{}", answer.stderr);
    assert_eq!(answer.code, 2, "{}", answer.stderr);
    // It learnt to its end all the same, and left nothing half written.
    assert_eq!(curve(&place.path("run")), curve(&place.path("whole")));
    assert_eq!(names(&place.path("run/checkpoints")), ["step-00000000"]);
    place.run("train resume run").ok();
    assert_eq!(curve(&place.path("run")), curve(&place.path("whole")));
}
