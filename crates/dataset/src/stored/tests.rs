use super::*;
use crate::Error;
use crate::check::synthetic::{nadir_pair, oblique_pair, write_own_pair};
use crate::export::stereolunar::{ExportOptions, export_dataset};
use crate::pair::ViewName;
use std::path::Path;

/// A dataset of two pairs in `own`, and the same as triplets of two lights in `deep/triplets/oblique`.
fn both() -> tempfile::TempDir {
    let root = tempfile::tempdir().unwrap();
    let dataset = root.path().join("own");
    for pair_id in [3, 1012] {
        write_own_pair(&dataset, pair_id, &if pair_id == 3 { oblique_pair(24) } else { nadir_pair(24) });
    }
    std::fs::create_dir(root.path().join("deep")).unwrap();
    let out = root.path().join("deep/triplets");
    export_dataset(&dataset, &out, None, &ExportOptions::default(), |_, _| ()).unwrap();
    root
}

#[test]
fn pairs_of_both_layouts_are_found_below_a_folder() {
    let root = both();
    std::fs::create_dir(root.path().join("own/pairs/000/.unfinished-5")).unwrap();
    let reading = ReadOptions::with_convention(selenograph_geometry::PixelConvention::Center);
    let found = find(root.path(), reading).unwrap();
    let names: Vec<&str> = found.iter().map(|pair| pair.name.as_str()).collect();
    let triplets = ["deep/triplets/oblique/im_00000", "deep/triplets/oblique/im_00006"];
    assert_eq!(names, [triplets[0], triplets[1], "own/000003", "own/001012"]);
    let alone = own(&root.path().join("own"), reading).unwrap();
    assert_eq!(alone.iter().map(|pair| pair.pair_id).collect::<Vec<_>>(), [3, 1012]);
    assert!(own(root.path(), reading).unwrap().is_empty() && find(Path::new("nowhere"), reading).is_err());
    // What one layout says of a pair, the other says too.
    for (a, b) in found[..2].iter().zip(&found[2..]) {
        let (a, b) = (a.open().unwrap(), b.open().unwrap());
        assert_eq!((a.lights(), a.trajectory()), (b.lights(), b.trajectory()));
        let (a, b) = (a.stereo().unwrap(), b.stereo().unwrap());
        for (a, b) in a.views.iter().zip(&b.views) {
            assert_eq!((&a.depth_z.data, &a.camera), (&b.depth_z.data, &b.camera));
            assert_eq!((a.images.len(), b.images.len()), (2, 2));
        }
    }
}

#[test]
fn a_changed_file_is_told_where_checksums_are_asked_for() {
    let root = both();
    let dataset = root.path().join("own");
    let folder = crate::pair::pair_folder(&dataset, 3);
    let read = |verify: bool| {
        let pairs = own(&dataset, ReadOptions { verify, ..ReadOptions::default() }).unwrap();
        let open = pairs[0].open().unwrap();
        open.picture(ViewName::A, 0, (24, 24)).unwrap();
        open.picture(ViewName::A, 1, (24, 24)).map(|_| ())
    };
    std::fs::copy(folder.join("a.l0.lit.png"), folder.join("a.l1.png")).unwrap();
    assert!(read(false).is_ok());
    let refused = read(true);
    assert!(
        matches!(&refused, Err(Error::Changed { path, .. }) if path.ends_with("a.l1.png")),
        "{refused:?}"
    );
}

#[test]
fn lights_that_contradict_each_other_are_refused_where_they_have_to_agree() {
    let root = both();
    let scene = root.path().join("deep/triplets/oblique");
    let agreed = |view| {
        let found = find(&scene, ReadOptions::default()).unwrap();
        assert_eq!(found[0].name, "im_00000");
        found[0].open().unwrap().agreed_view(view).map(|raw| raw.depth_z.width)
    };
    assert!(matches!(agreed(ViewName::A), Ok(24)));
    std::fs::copy(scene.join("im_00001.exr"), scene.join("im_00002.exr")).unwrap();
    let refused = agreed(ViewName::A);
    assert!(
        matches!(&refused, Err(Error::Format { path, .. }) if path.ends_with("im_00002.exr")),
        "{refused:?}"
    );
    assert!(agreed(ViewName::B).is_ok());
}
