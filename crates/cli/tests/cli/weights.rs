//! `weights`.

use crate::program::Place;

#[test]
fn random_weights_are_told_and_converted() {
    let place = Place::new();
    place.run("weights random --preset tiny --seed 3 --out a.safetensors").ok();
    let info = place.run("weights info a.safetensors --json").ok().json();
    assert_eq!(info["parameters"], 16_442_728);
    assert_eq!((&info["complete"], &info["family"]), (&true.into(), &"MASt3R".into()));
    assert_eq!(info["config"]["encoder"]["num_heads"], 4);
    assert!(info["license"].as_str().unwrap().contains("CC0"));
    assert!(info["provenance"].as_str().unwrap().contains("seed 3"));
    place.run("weights convert a.safetensors --store-as bf16 --license none --out b.safetensors").ok();
    let told = place.run("weights info b.safetensors").ok().stdout;
    for words in ["16 442 728 bf16", "licence         none", "complete", "converted from a.safetensors"] {
        assert!(told.contains(words), "{words}: {told}");
    }
    assert_eq!(place.names(), ["a.safetensors", "b.safetensors"]);
}

#[test]
fn a_network_with_a_stem_is_told_with_its_parts() {
    let place = Place::new();
    place.run("weights random --preset hybrid --out a.safetensors").ok();
    let info = place.run("weights info a.safetensors --json").ok().json();
    assert_eq!((&info["parameters"], &info["complete"]), (&6_560_778.into(), &true.into()));
    assert_eq!(info["config"]["stem_dims"], serde_json::json!([24, 48, 96]));
    let told = place.run("weights info a.safetensors").ok().stdout;
    assert!(told.contains("stem"), "{told}");
}

#[test]
fn what_is_no_checkpoint_is_refused() {
    let place = Place::new();
    place.write("notes.txt", "not weights, not at all");
    place.run("weights info notes.txt").refused("not a checkpoint", "torch.save");
    place.run("weights info absent.pth").refused("absent.pth", "check the path");
    place.run("weights info .").refused("a folder", "torch.save");
    place.run("weights random --preset giant --out g.safetensors").refused("not a preset", "mast3r-vitl");
    place.write("taken", "x");
    place.run("weights random --preset tiny --out taken").refused("exists", "--force");
    assert_eq!(place.names(), ["notes.txt", "taken"]);
}
