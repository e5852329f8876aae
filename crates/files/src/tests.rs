//! What a full disk, a kill and a second process leave: nothing half written, nothing lost, nothing in the way.

use super::*;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

static FOLDER: FolderKind = FolderKind {
    command: "make folder",
    what: "a folder of tests",
    is_own: |folder| record::is_of(folder, "make folder"),
    names: &["run.toml", "pictures/#.png"],
    parts: &[],
};
static SEVERAL: FolderKind = FolderKind {
    command: "make several",
    is_own: |folder| record::is_of(folder, "make several"),
    names: &["run.toml"],
    parts: &[("one", &FOLDER)],
    ..FOLDER
};
static PICTURE: FileKind = FileKind::png("make picture");
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n and so on";

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn record(folder: &Path, command: &'static str) {
    let settings = std::collections::BTreeMap::<&str, f64>::new();
    record::RunRecord::<_, ()>::new(command, &settings).write(&folder.join("run.toml")).unwrap();
}

fn fill(folder: &Path) {
    std::fs::create_dir_all(folder.join("pictures")).unwrap();
    write(&folder.join("pictures/001.png"), PNG).unwrap();
    record(folder, "make folder");
}

fn made(target: &Path, existing: Existing) -> Result<(), Error> {
    let draft = FolderDraft::claim(target, &FOLDER, existing)?;
    fill(draft.path());
    draft.commit()
}

/// What the child process does, by name; it is run by [`child`] and never returns where it is to be killed.
#[test]
fn as_child() {
    let Some(task) = std::env::var_os("SELENOGRAPH_FILES_TEST") else { return };
    let dir = PathBuf::from(std::env::var_os("SELENOGRAPH_FILES_PLACE").unwrap());
    let wait = || -> ! {
        println!("\nready");
        loop {
            std::thread::park();
        }
    };
    match task.to_str().unwrap() {
        "file" => {
            let target = FileTarget::claim(&dir.join("a.png"), &PICTURE, Existing::Replace).unwrap();
            let mut draft = FileDraft::new(target.path()).unwrap();
            draft.write_all(PNG).unwrap();
            wait()
        }
        "folder" => {
            let draft = FolderDraft::claim(&dir.join("out"), &FOLDER, Existing::Replace).unwrap();
            fill(draft.path());
            wait()
        }
        "replacement" => {
            // Between the two steps of `commit`.
            let _draft = FolderDraft::claim(&dir.join("out"), &FOLDER, Existing::Replace).unwrap();
            std::fs::rename(dir.join("out"), names::replaced_of(&dir.join("out"))).unwrap();
            wait()
        }
        "held" => {
            let held = HeldFolder::take(&dir.join("out"), &FOLDER, Existing::Resume, Sharing::Alone).unwrap();
            held.begin().unwrap();
            wait()
        }
        "part" => {
            let part = Sharing::Part(1);
            let held = HeldFolder::take(&dir.join("out"), &FOLDER, Existing::Replace, part).unwrap();
            held.begin().unwrap();
            wait()
        }
        "full" => {
            let big = vec![7; 1 << 20];
            let error = write(&dir.join("a.png"), &big).unwrap_err();
            assert!(error.to_string().contains("a.png"), "{error}");
            let draft = FolderDraft::claim(&dir.join("out"), &FOLDER, Existing::Replace).unwrap();
            fill(draft.path());
            let error = write(&draft.path().join("pictures/002.png"), &big).unwrap_err();
            assert!(error.to_string().contains("002.png"), "{error}");
            println!("\n{error}");
        }
        "abandon" => {
            let draft = FolderDraft::claim(&dir.join("deeper/out"), &FOLDER, Existing::Refuse).unwrap();
            fill(draft.path());
            let file = FileDraft::new(&dir.join("a.png")).unwrap();
            abandon();
            std::mem::forget((draft, file));
        }
        other => panic!("{other}"),
    }
}

fn command(task: &str, dir: &Path, before: &str) -> Command {
    let exe = std::env::current_exe().unwrap();
    let mut command = Command::new("sh");
    let script = format!("{before} exec '{}' --exact tests::as_child --nocapture", exe.display());
    command.args(["-c", &script]).env("SELENOGRAPH_FILES_TEST", task).env("SELENOGRAPH_FILES_PLACE", dir);
    command
}

/// A process that has done its task up to where it is to be killed.
fn child(task: &str, dir: &Path) -> Child {
    let mut child = command(task, dir, "").stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let out = BufReader::new(child.stdout.take().unwrap());
    assert!(out.lines().any(|line| line.unwrap() == "ready"));
    child
}

fn killed(task: &str, dir: &Path) {
    let mut child = child(task, dir);
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_kill_leaves_the_old_and_nothing_in_the_way() {
    let dir = tempfile::tempdir().unwrap();
    let (file, out) = (dir.path().join("a.png"), dir.path().join("out"));
    write(&file, [PNG, b"old"].concat()).unwrap();
    made(&out, Existing::Refuse).unwrap();
    assert_eq!(names(dir.path()), ["a.png", "out"]);
    killed("file", dir.path());
    killed("folder", dir.path());
    assert_eq!(std::fs::read(&file).unwrap(), [PNG, b"old"].concat());
    assert_eq!(names(&out), ["pictures", "run.toml"]);
    // The next of the same clears what is left.
    let target = FileTarget::claim(&file, &PICTURE, Existing::Replace).unwrap();
    write(target.path(), PNG).unwrap();
    drop(target);
    made(&out, Existing::Replace).unwrap();
    assert_eq!(names(dir.path()), ["a.png", "out"]);
}

#[test]
fn a_kill_in_the_middle_of_a_replacement_gives_the_old_one_back() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    made(&out, Existing::Refuse).unwrap();
    killed("replacement", dir.path());
    assert!(!out.exists());
    assert!(matches!(made(&out, Existing::Refuse), Err(Error::Exists { .. })));
    assert_eq!(
        (names(dir.path()), names(&out)),
        (vec!["out".into()], vec!["pictures".into(), "run.toml".into()])
    );
    // One that is left beside the new one is only cleared.
    std::fs::create_dir(dir.path().join(".out.replaced")).unwrap();
    made(&out, Existing::Replace).unwrap();
    assert_eq!(names(dir.path()), ["out"]);
}

#[test]
fn a_second_process_is_told_who_writes_and_a_killed_one_holds_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let take = |existing, sharing| HeldFolder::take(&out, &FOLDER, existing, sharing);
    for (task, with) in [("folder", None), ("held", Some(Sharing::Alone)), ("held", Some(Sharing::Part(0)))] {
        let mut child = child(task, dir.path());
        let error = match with {
            None => made(&out, Existing::Replace).unwrap_err(),
            Some(sharing) => take(Existing::Resume, sharing).unwrap_err(),
        };
        let told = format!("out` is in use by `selenograph make folder` (process {})", child.id());
        assert!(error.to_string().ends_with(&told), "{error}");
        child.kill().unwrap();
        child.wait().unwrap();
        match with {
            None => made(&out, Existing::Replace).unwrap(),
            Some(sharing) => drop(take(Existing::Resume, sharing).unwrap()),
        }
    }
    // Parts are written beside each other, each once, and replaced by nobody meanwhile.
    let mut child = child("part", dir.path());
    assert!(matches!(take(Existing::Resume, Sharing::Part(1)), Err(Error::InUse { .. })));
    let refused = take(Existing::Replace, Sharing::Part(0));
    assert!(matches!(refused, Err(Error::InUse { .. })), "{refused:?}");
    assert!(matches!(take(Existing::Resume, Sharing::Alone), Err(Error::InUse { .. })));
    let other = take(Existing::Resume, Sharing::Part(0)).unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    drop(take(Existing::Resume, Sharing::Part(1)).unwrap());
    drop(other);
    drop(take(Existing::Replace, Sharing::Alone).unwrap());
    assert_eq!((names(dir.path()), names(&out)), (vec!["out".to_owned()], vec![]));
}

/// A file may not become larger than 64 kB: the system's way to have no room that needs no rights.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_the_old_and_names_the_file() {
    let dir = tempfile::tempdir().unwrap();
    write(&dir.path().join("a.png"), PNG).unwrap();
    made(&dir.path().join("out"), Existing::Refuse).unwrap();
    let output = command("full", dir.path(), "trap '' XFSZ; ulimit -f 128;").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    assert_eq!(names(dir.path()), ["a.png", "out"]);
    assert_eq!(names(&dir.path().join("out/pictures")), ["001.png"]);
    assert_eq!(std::fs::read(dir.path().join("a.png")).unwrap(), PNG);
    let full = Error::io("write", Path::new("a.png"))(std::io::ErrorKind::StorageFull.into());
    assert!(full.to_string().starts_with("the disk is full: cannot write `a.png`"), "{full}");
}

#[test]
fn only_the_own_is_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    made(&at("out"), Existing::Refuse).unwrap();
    std::fs::write(at("out/pictures/me.png"), PNG).unwrap();
    let error = made(&at("out"), Existing::Replace).unwrap_err().to_string();
    assert!(error.contains("holds `pictures/me.png`, which is no part of a folder of tests"), "{error}");
    std::fs::remove_file(at("out/pictures/me.png")).unwrap();
    made(&at("out"), Existing::Replace).unwrap();
    // Another command's folder, and one of nobody's.
    std::fs::create_dir(at("keep")).unwrap();
    std::fs::write(at("keep/thesis.tex"), "years").unwrap();
    for name in ["out", "keep"] {
        let error = FolderDraft::claim(&at(name), &SEVERAL, Existing::Replace).unwrap_err();
        assert!(matches!(error, Error::OtherKind { found: "a folder of something else", .. }), "{error}");
        assert!(
            error.hint().unwrap().contains("older releases") && error.hint().unwrap().contains("by hand")
        );
    }
    // An empty folder is nobody's loss.
    std::fs::create_dir(at("empty")).unwrap();
    made(&at("empty"), Existing::Refuse).unwrap();
    // Files: neither a folder nor a file of another kind.
    let file = |name: &str| FileTarget::claim(&at(name), &PICTURE, Existing::Replace).map(|_| ());
    std::fs::write(at("notes"), "mine").unwrap();
    assert!(matches!(file("keep"), Err(Error::OtherKind { found: "a folder", .. })));
    assert!(matches!(file("notes"), Err(Error::OtherKind { found: "another file", .. })));
    assert!(matches!(
        made(&at("notes"), Existing::Replace),
        Err(Error::OtherKind { found: "no folder", .. })
    ));
    std::fs::write(at("notes"), "").unwrap();
    file("notes").unwrap();
    assert!(names(dir.path()).iter().all(|name| !name.starts_with('.')), "{:?}", names(dir.path()));
}

#[test]
fn a_file_that_the_record_does_not_name_is_foreign_whatever_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    made(&out, Existing::Refuse).unwrap();
    let read = || record::read(&out.join("run.toml")).unwrap();
    assert_eq!(read().files, Some(["pictures/001.png".to_owned()].into()));
    assert_eq!(read().is_as_written, Some(true));
    std::fs::write(out.join("pictures/002.png"), PNG).unwrap();
    assert!(matches!(
        made(&out, Existing::Replace),
        Err(Error::Foreign { ref foreign, .. }) if foreign == Path::new("pictures/002.png")
    ));
    std::fs::remove_file(out.join("pictures/002.png")).unwrap();
    made(&out, Existing::Replace).unwrap();
    // One that is filled bit by bit, and those of older releases, name none: patterns are all there is.
    let old = dir.path().join("old");
    fill(&old);
    assert_eq!(record::read(&old.join("run.toml")).unwrap().files, None);
    std::fs::write(old.join("pictures/002.png"), PNG).unwrap();
    made(&old, Existing::Replace).unwrap();
}

#[cfg(unix)]
#[test]
fn a_link_stays_and_what_it_names_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    made(&at("deep/out"), Existing::Refuse).unwrap();
    std::os::unix::fs::symlink("deep/out", at("link")).unwrap();
    made(&at("link"), Existing::Replace).unwrap();
    assert!(at("link").is_symlink() && at("deep/out/run.toml").is_file());
    std::os::unix::fs::symlink("nowhere", at("broken")).unwrap();
    assert!(made(&at("broken"), Existing::Replace).is_err());
}

#[test]
fn a_held_folder_stays_is_gone_on_with_and_is_replaced_whole() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("deeper/out");
    let take = |kind, existing| HeldFolder::take(&out, kind, existing, Sharing::Alone);
    // What stays empty goes.
    take(&FOLDER, Existing::Refuse).unwrap().begin().unwrap();
    assert!(names(dir.path()).is_empty());
    let held = take(&FOLDER, Existing::Refuse).unwrap();
    fill(held.path());
    drop(held);
    assert_eq!(names(&out), ["pictures", "run.toml"]);
    assert!(matches!(take(&FOLDER, Existing::Refuse), Err(Error::Exists { .. })));
    assert!(matches!(take(&SEVERAL, Existing::Resume), Err(Error::OtherKind { .. })));
    take(&FOLDER, Existing::Resume).unwrap().begin().unwrap();
    assert_eq!(names(&out), ["pictures", "run.toml"]);
    take(&FOLDER, Existing::Replace).unwrap().begin().unwrap();
    assert!(names(&out).is_empty(), "{:?}", names(&out));
}

#[test]
fn a_folder_of_parts_owns_what_is_theirs() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    fill(&out.join("one"));
    record(&out, "make several");
    FolderDraft::claim(&out, &SEVERAL, Existing::Replace).unwrap();
    std::fs::write(out.join("one/me.txt"), "mine").unwrap();
    assert!(matches!(
        FolderDraft::claim(&out, &SEVERAL, Existing::Replace),
        Err(Error::Foreign { ref foreign, .. }) if foreign == Path::new("one/me.txt")
    ));
}

#[test]
fn records_of_every_release_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.toml");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        record::read(&path)
    };
    let settings = std::collections::BTreeMap::from([("cell_m", 2.0)]);
    let mut new = record::RunRecord::new("reconstruct", &settings);
    (new.started, new.threads, new.outcome) = (Some("today"), Some(2), Some(&settings));
    new.inputs.insert("a.png".into(), "1f".into());
    let found = read(&new.to_toml().unwrap()).unwrap();
    assert_eq!((found.command.as_str(), found.inputs["a.png"].as_str()), ("reconstruct", "1f"));
    assert!(found.outcome.is_some() && found.settings["cell_m"].as_float() == Some(2.0));
    for (old, command, input) in [
        ("evaluated = \"d\"\nsettings_blake3 = \"s\"\ndataset_blake3 = \"1\"\n[settings]\n", "evaluate", "d"),
        ("seed = 1\ncampaign_blake3 = \"1\"\nplan_blake3 = \"2\"\n[inputs]\n", "generate", "plan.csv"),
        ("imported = \"stereolunar\"\nsource = \"x\"\n", "data import", ""),
        (
            "command = \"reconstruct\"\nthreads = 2\n[inputs]\n\"a.png\" = \"1f\"\n[settings]\n",
            "reconstruct",
            "a.png",
        ),
        ("data = []\nallow_leak = false\n[inputs]\n\"w\" = \"1\"\n[settings]\n", "train run", "w"),
    ] {
        let found = read(old).unwrap();
        assert_eq!(found.command, command);
        assert!(input.is_empty() || found.inputs.contains_key(input), "{found:?}");
    }
    assert!(matches!(read("name = \"mine\"\n"), Err(Error::NoRecord { .. })));
    assert!(matches!(read("{"), Err(Error::NoRecord { .. })));
}

#[test]
fn an_end_from_outside_takes_drafts_and_locks_along() {
    // In a process of its own, so that other tests keep theirs.
    let dir = tempfile::tempdir().unwrap();
    let output = command("abandon", dir.path(), "").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    assert!(names(dir.path()).is_empty(), "{:?}", names(dir.path()));
}
