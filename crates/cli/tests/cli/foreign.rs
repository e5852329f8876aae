//! Other people's files and other hands: what is not of a command's making stays, whoever writes is alone, whoever is stopped says what
//! is kept.

use crate::campaign::with_terrain;
use crate::evaluate::with_dataset;
use crate::photometry::with_triplets;
use crate::program::{Answer, Place, names};
use crate::reconstruct::with_pair;
use crate::tiff::Dem;

/// `--force` on someone's folder, on the own one with someone's file in it, and on the own one.
fn folder_is_safe(place: &Place, line: &str) {
    std::fs::create_dir_all(place.path("keep/deeper")).unwrap();
    place.write("keep/thesis.tex", "years");
    place.write("keep/deeper/photo.jpg", "mine");
    let before = place.names();
    let forced = |out: &str| place.run(&format!("{line} --out {out} --force -q"));
    forced("keep").refused("`keep` is a folder of something else", "another --out");
    assert_eq!(
        (names(&place.path("keep")), place.names()),
        (vec!["deeper".into(), "thesis.tex".into()], before)
    );

    place.run(&format!("{line} --out own -q")).ok();
    let made = names(&place.path("own"));
    let inner = made.iter().map(|name| format!("own/{name}")).find(|name| place.path(name).is_dir());
    for folder in ["own"].into_iter().chain(inner.as_deref()) {
        let foreign = place.write(&format!("{folder}/thesis.tex"), "years");
        let name = format!("{folder}/thesis.tex").replacen("own/", "", 1);
        forced("own").refused(&format!("`own` holds `{name}`, which is no part of"), "move it elsewhere");
        assert_eq!(std::fs::read(&foreign).unwrap(), b"years");
        std::fs::remove_file(foreign).unwrap();
    }
    place.write("file", "mine");
    forced("file").refused("`file` is no folder", "another --out");
    forced("own").ok();
    assert_eq!(names(&place.path("own")), made);
    nothing_hidden(place);
    std::fs::remove_dir_all(place.path("own")).unwrap();
}

/// The same for a command that writes a file.
fn file_is_safe(place: &Place, line: &str) {
    std::fs::create_dir_all(place.path("keep")).unwrap();
    place.write("keep/thesis.tex", "years");
    place.write("notes", "mine");
    let forced = |out: &str| place.run(&format!("{line} --out {out} --force -q"));
    forced("keep").refused("`keep` is a folder, not", "another --out");
    forced("notes").refused("`notes` is another file, not", "another --out");
    assert_eq!(std::fs::read(place.path("notes")).unwrap(), b"mine");
    place.run(&format!("{line} --out own -q")).ok();
    place.run(&format!("{line} --out own -q")).refused("`own` exists", "--force");
    forced("own").ok();
    nothing_hidden(place);
    std::fs::remove_file(place.path("own")).unwrap();
}

fn nothing_hidden(place: &Place) {
    assert!(place.names().iter().all(|name| !name.starts_with('.')), "{:?}", place.names());
}

#[test]
fn terrains_pictures_plans_and_datasets_replace_their_own_only() {
    let place = with_terrain();
    place.write("hills.tif", Dem::hills(32, 20.0).bytes());
    folder_is_safe(&place, "dem import hills.tif");
    folder_is_safe(&place, "generate tiny.toml --terrain terrain");
    folder_is_safe(
        &place,
        "render terrain --lat-deg -90 --lon-deg 0 --altitude-m 3000 --width 16 --height 16 --rays-per-pixel 1",
    );
    file_is_safe(&place, "dem synth --size 16");
    file_is_safe(&place, "dem hillshade hills.tif");
    file_is_safe(&place, "plan tiny.toml --terrain terrain");
    file_is_safe(&place, "weights random --preset tiny");
}

#[test]
fn what_is_made_of_datasets_replaces_its_own_only() {
    let place = with_dataset();
    folder_is_safe(&place, "data sheet dataset");
    folder_is_safe(&place, "data export dataset");
    folder_is_safe(&place, "evaluate dataset --method plane --method truth");
    file_is_safe(&place, "data split dataset --val-share 0.34");
    let place = with_triplets();
    folder_is_safe(&place, "data import triplets");
    folder_is_safe(&place, "data check triplets/nadir --render");
}

#[test]
fn a_file_with_a_name_like_ours_is_told_from_ours() {
    let place = with_dataset();
    for (line, foreign) in [
        ("evaluate dataset --method plane --method truth", "tables/mine.csv"),
        ("data sheet dataset", "sheet_777.png"),
        ("data export dataset", "nadir_1/im_77777.jpg"),
    ] {
        place.run(&format!("{line} --out own -q")).ok();
        std::fs::create_dir_all(place.path(&format!("own/{foreign}")).parent().unwrap()).unwrap();
        let foreign_path = place.write(&format!("own/{foreign}"), "mine");
        let forced = place.run(&format!("{line} --out own --force -q"));
        forced.refused(&format!("`own` holds `{foreign}`, which is no part of"), "move it elsewhere");
        std::fs::remove_file(foreign_path).unwrap();
        place.run(&format!("{line} --out own --force -q")).ok();
        // Of a release that wrote no record, the way out is told.
        std::fs::remove_file(place.path("own/run.toml")).unwrap();
        place
            .run(&format!("{line} --out own --force -q"))
            .refused("`own` is a folder of something else", "by hand");
        std::fs::remove_dir_all(place.path("own")).unwrap();
    }
}

#[test]
fn what_is_made_of_pictures_replaces_its_own_only() {
    let place = with_pair();
    folder_is_safe(&place, "reconstruct a.png b.png --fov-deg 45 --baseline-m 80");
    std::fs::create_dir(place.path("seq")).unwrap();
    for name in ["a.png", "b.png"] {
        std::fs::copy(place.path(name), place.path("seq").join(name)).unwrap();
    }
    folder_is_safe(&place, "frames seq --every 1 --size 16");
}

#[cfg(unix)]
mod running {
    use super::*;
    use std::path::Path;
    use std::process::{Child, Stdio};

    fn spawned(place: &Place, line: &str) -> Child {
        let mut command = place.command(env!("CARGO_BIN_EXE_selenograph"));
        command.args(line.split_whitespace()).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap()
    }

    fn until(child: &mut Child, path: &Path) {
        while !path.exists() {
            assert!(child.try_wait().unwrap().is_none(), "{} never came", path.display());
        }
    }

    fn interrupted(place: &Place, child: Child) -> Answer {
        let line = format!("kill -INT {}", child.id());
        assert!(place.command("sh").args(["-c", &line]).status().unwrap().success());
        Answer::of(&child.wait_with_output().unwrap())
    }

    #[test]
    fn a_file_is_written_by_one_and_leaves_nothing_when_it_is_stopped() {
        let place = Place::new();
        let line = "dem synth --size 8192 --out moon.tif";
        let mut child = spawned(&place, line);
        until(&mut child, &place.path(".moon.tif.partial"));
        place.run("dem synth --size 16 --out moon.tif --force").refused(
            &format!("`moon.tif` is in use by `selenograph dem synth` (process {})", child.id()),
            "wait for its end",
        );
        let answer = interrupted(&place, child);
        assert_eq!(answer.code, 130, "{}", answer.stderr);
        assert!(answer.stderr.ends_with("stopped: nothing was written to `moon.tif`\n"), "{}", answer.stderr);
        assert!(place.names().is_empty(), "{:?}", place.names());
        // Killed, it can clear nothing; the next of the same does.
        let mut child = spawned(&place, line);
        until(&mut child, &place.path(".moon.tif.partial"));
        child.kill().unwrap();
        child.wait().unwrap();
        place.run("dem synth --size 16 --out moon.tif").ok();
        assert_eq!(place.names(), ["moon.tif"]);
    }

    #[test]
    fn a_dataset_is_written_by_one_and_kept_when_it_is_stopped() {
        let place = with_terrain();
        let line = "generate tiny.toml --terrain terrain --set nadir.pairs=40 --set camera.width_px=96 --out dataset";
        let mut child = spawned(&place, line);
        until(&mut child, &place.path("dataset/pairs/000/000000"));
        let told = format!("`dataset` is in use by `selenograph generate` (process {})", child.id());
        for again in [line.to_owned(), format!("{line} --force"), format!("{line} --shard 1 --shards 2")] {
            place.run(&again).refused(&told, "wait for its end");
        }
        let answer = interrupted(&place, child);
        assert_eq!(answer.code, 130, "{}", answer.stderr);
        let told = "stopped: what is complete in `dataset` is kept; the same command goes on\n";
        assert!(answer.stderr.ends_with(told), "{}", answer.stderr);
        let report = place.run(&format!("{line} --json")).ok().json();
        assert!(report["num_resumed"].as_u64().unwrap() >= 1, "{report}");
        assert_eq!(names(&place.path("dataset")), ["campaign.toml", "pairs", "plan.csv", "run.toml"]);
        assert_eq!(names(&place.path("dataset/pairs/000")).len(), 42);
    }

    #[test]
    fn a_demo_is_written_by_one_and_goes_on_with_its_own_moon_only() {
        let place = Place::new();
        let mut child = spawned(&place, "demo --out out");
        until(&mut child, &place.path("out/.moon.tif.partial"));
        place.run("demo --out out").refused("`out` is in use by `selenograph demo`", "wait for its end");
        let answer = interrupted(&place, child);
        assert!(answer.stderr.contains("stopped: what is complete in `out` is kept"), "{}", answer.stderr);
        assert_eq!(names(&place.path("out")), ["run.toml"]);
        place.run("demo --out out --seed 2").refused("was begun with another seed", "--force");
        place.write("out/thesis.tex", "years");
        place.run("demo --out out --force").refused("`out` holds `thesis.tex`", "move it elsewhere");
        assert_eq!(names(&place.path("out")), ["run.toml", "thesis.tex"]);
    }

    /// Runs in a folder `full` of so many kilobytes; `None` where this user may mount none.
    fn on_full_disk(place: &Place, kilobytes: usize, line: &str) -> Option<Answer> {
        std::fs::create_dir_all(place.path("full")).unwrap();
        let program = env!("CARGO_BIN_EXE_selenograph");
        let mount = format!("mount -t tmpfs -o size={kilobytes}k tmpfs full");
        let may = place.command("unshare").args(["-rm", "sh", "-c", &mount]).output();
        if !may.is_ok_and(|output| output.status.success()) {
            eprintln!("SKIP: no disk of {kilobytes} kB can be made here");
            return None;
        }
        let script = format!("{mount} && {program} {line}; code=$?; ls -A full >&2; exit $code");
        Some(Answer::of(&place.command("unshare").args(["-rm", "sh", "-c", &script]).output().unwrap()))
    }

    #[test]
    fn a_full_disk_is_told_with_what_is_kept() {
        let place = with_terrain();
        for (kilobytes, line, path, kept) in [
            (
                256,
                "dem synth --size 1024 --out full/moon.tif",
                "full/moon.tif",
                "nothing was written to `full/moon.tif`\n",
            ),
            (256, "dem import terrain.tif --out full/terrain", "", "nothing was written to `full/terrain`\n"),
            (
                400,
                "generate tiny.toml --terrain terrain --out full/dataset",
                "full/dataset/",
                "what is complete in `full/dataset` is kept\ndataset\n",
            ),
        ] {
            if line.starts_with("dem import") {
                place.write("terrain.tif", Dem::hills(512, 20.0).bytes());
            }
            let Some(answer) = on_full_disk(&place, kilobytes, line) else { return };
            assert_eq!(answer.code, 2, "{line}: {}", answer.stderr);
            let wanted = format!("error: the disk is full: cannot write `{path}");
            assert!(answer.stderr.contains(&wanted), "{line}: {}", answer.stderr);
            let wanted = format!("hint: free some space and run the same command again: {kept}");
            // Nothing else is left there.
            assert!(answer.stderr.ends_with(&wanted), "{line}: {}", answer.stderr);
        }
    }
}
