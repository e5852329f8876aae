//! Matches, cameras and scenes to and from other programs.

use crate::evaluate::with_dataset;
use crate::program::{Place, names};
use crate::reconstruct::with_pair;
use selenograph_raster::codec::{jpeg, png};

/// A JPEG of a picture with a focal length in 35 mm film (mm) and an orientation in its EXIF.
fn jpeg_with_exif(place: &Place, name: &str, focal_35mm: u16, orientation: u16) {
    let grey = png::read(&place.path(&format!("{name}.png"))).unwrap().to_unit_grey();
    let picture = jpeg::encode_grey_as_rgb(&grey.map(|v| (v * 255.0).round() as u8), 98).unwrap();
    let short = |tag: u16, value: u16| {
        [&tag.to_le_bytes()[..], &3u16.to_le_bytes(), &1u32.to_le_bytes(), &u32::from(value).to_le_bytes()]
            .concat()
    };
    let long = [&34665u16.to_le_bytes()[..], &4u16.to_le_bytes(), &1u32.to_le_bytes(), &38u32.to_le_bytes()];
    let mut tags = b"II*\0\x08\0\0\0\x02\0".to_vec();
    tags.extend(short(274, orientation));
    tags.extend(long.concat());
    tags.extend([0; 4]);
    tags.extend(1u16.to_le_bytes());
    tags.extend(short(41989, focal_35mm));
    tags.extend([0; 4]);
    let mut bytes = picture[..2].to_vec();
    bytes.extend(b"\xff\xe1");
    bytes.extend((tags.len() as u16 + 8).to_be_bytes());
    bytes.extend(b"Exif\0\0");
    bytes.extend(tags);
    bytes.extend(&picture[2..]);
    place.write(&format!("{name}.jpg"), bytes);
}

#[test]
fn exif_tells_the_focal_length_and_how_a_picture_is_turned() {
    let place = with_pair();
    for name in ["a", "b"] {
        jpeg_with_exif(&place, name, 36, 6);
    }
    let answer = place.run("reconstruct a.jpg b.jpg --no-report --out out").ok();
    // 36 mm over a diagonal of 43.27 mm, of 160 √2 px.
    for said in ["188.3 px", "35 mm equivalent", "EXIF tells", "90° clockwise"] {
        assert!(answer.stderr.contains(said), "{said}: {}", answer.stderr);
    }
    let record = std::fs::read_to_string(place.path("out/run.toml")).unwrap();
    assert!(record.contains("\"exif\"") && record.contains("188.2"), "{record}");
    // A focal length that is given is believed.
    let answer = place.run("reconstruct a.jpg b.jpg --fov-deg 45 --no-report --out two").ok();
    assert!(!answer.stderr.contains("EXIF tells"), "{}", answer.stderr);
    jpeg_with_exif(&place, "a", 36, 2);
    place.run("reconstruct a.jpg b.jpg --out three -q").refused("mirrored", "upright");
}

/// The crops hold no EXIF, so that what it says is said here.
#[test]
fn frames_say_how_they_are_turned_and_leave_mirrored_ones_out() {
    let place = with_pair();
    std::fs::create_dir(place.path("film")).unwrap();
    for (name, orientation) in [("a", 8), ("b", 8)] {
        jpeg_with_exif(&place, name, 36, orientation);
        std::fs::rename(place.path(&format!("{name}.jpg")), place.path(&format!("film/{name}.jpg"))).unwrap();
    }
    let answer = place.run("frames film --size 64 --every 1 --out cut").ok();
    for said in
        ["`a.jpg`: EXIF (orientation 8)", "90° anticlockwise", "taken as stored", "in 2 of the frames"]
    {
        assert!(answer.stderr.contains(said), "{said}: {}", answer.stderr);
    }
    jpeg_with_exif(&place, "a", 36, 2);
    std::fs::rename(place.path("a.jpg"), place.path("film/c.jpg")).unwrap();
    let answer = place.run("frames film --size 64 --every 1 --out again");
    assert_eq!(answer.code, 3, "{}", answer.stderr);
    assert!(answer.stderr.contains("c.jpg: it is stored mirrored (EXIF orientation 2)"), "{}", answer.stderr);
}

#[test]
fn matches_go_out_and_come_back() {
    let place = with_pair();
    let first = place.run("reconstruct a.png b.png --fov-deg 45 --no-report --out out --json -q").ok().json();
    let text = std::fs::read_to_string(place.path("out/matches.csv")).unwrap();
    assert!(text.starts_with("a_x,a_y,b_x,b_y,score,inlier\n"));
    let again = "reconstruct a.png b.png --fov-deg 45 --matches out/matches.csv --no-report";
    let answer = place.run(&format!("{again} --out two --json")).ok();
    assert!(answer.stderr.contains("right to 0.10 px at best"), "{}", answer.stderr);
    let answer = answer.json();
    let rows = |answer: &serde_json::Value| -> Vec<f64> {
        let rows = answer["pose"]["cam_b_from_cam_a"].as_array().unwrap();
        rows.iter().flat_map(|row| row.as_array().unwrap()).map(|v| v.as_f64().unwrap()).collect()
    };
    let apart = rows(&first).iter().zip(rows(&answer)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 0.02, "{apart}");
    // Whole pixels, of a matcher that counts from the first pixel's centre.
    let whole: String = text
        .lines()
        .skip(1)
        .map(|line| {
            let cells = line.split(',').take(4).map(|cell| cell.parse::<f64>().unwrap().floor().to_string());
            cells.collect::<Vec<_>>().join(" ") + "\n"
        })
        .collect();
    place.write("whole.txt", &whole);
    let centre = "--matches whole.txt --matches-convention center";
    let run = format!("reconstruct a.png b.png --fov-deg 45 {centre} --no-report --out three");
    let answer = place.run(&run).ok();
    assert!(answer.stderr.contains("rounded to 1.000 px: taken as right to 0.29 px"), "{}", answer.stderr);
    for (options, says) in [
        ("--matches whole.txt --method orb", "not `orb`"),
        ("--matches whole.txt --method mast3r", "not `mast3r`"),
        ("--matches a.png", "no text"),
        ("--matches nowhere.csv", "nowhere.csv"),
    ] {
        let run = format!("reconstruct a.png b.png --fov-deg 45 {options} --out four -q");
        place.run(&run).refused(says, "");
    }
}

#[test]
fn an_answer_is_a_scene_for_colmap_and_nerfstudio() {
    let place = with_pair();
    std::fs::create_dir(place.path("left")).unwrap();
    std::fs::rename(place.path("a.png"), place.path("left/a.png")).unwrap();
    place.run("reconstruct left/a.png b.png --fov-deg 45 --baseline-m 80 --no-report --out out -q").ok();
    let files = names(&place.path("out/colmap"));
    assert_eq!(
        files,
        ["cameras.bin", "cameras.txt", "images.bin", "images.txt", "points3D.bin", "points3D.txt"]
    );
    let text = std::fs::read(place.path("out/nerfstudio/transforms.json")).unwrap();
    let transforms: serde_json::Value = serde_json::from_slice(&text).unwrap();
    for frame in transforms["frames"].as_array().unwrap() {
        let path = place.path("out/nerfstudio").join(frame["file_path"].as_str().unwrap());
        assert!(path.is_file(), "{}", path.display());
    }
    // And it is a camera file of each picture, with its place.
    let again = "reconstruct left/a.png b.png --camera out/colmap --world-from-cam-a out/colmap --world-from-cam-b out/colmap";
    let answer = place.run(&format!("{again} --no-report --out two --json -q")).ok().json();
    assert_eq!(answer["pose"]["source"], "given");
}

#[test]
fn a_dataset_goes_out_as_a_scene() {
    let place = with_dataset();
    let summary = place.run("data export dataset --format colmap --out colmap --json -q").ok().json();
    let num_images = summary["num_images"].as_u64().unwrap() as usize;
    assert!(summary["num_points"].as_u64().unwrap() > 0);
    let pictures = names(&place.path("colmap/images"));
    assert_eq!(pictures.len(), num_images);
    assert!(
        place.path("colmap/sparse/0/points3D.bin").is_file() && place.path("colmap/transform.json").is_file()
    );
    place.run("data export dataset --format nerfstudio --out nerf -q").ok();
    let text = std::fs::read(place.path("nerf/transforms.json")).unwrap();
    let transforms: serde_json::Value = serde_json::from_slice(&text).unwrap();
    let frames = transforms["frames"].as_array().unwrap();
    assert_eq!(frames.len(), num_images);
    for frame in frames {
        assert!(place.path("nerf").join(frame["file_path"].as_str().unwrap()).is_file());
        // Level at the site: 32 bits hold such distances.
        assert!(frame["transform_matrix"][2][3].as_f64().unwrap().abs() < 200_000.0);
    }
    place.write("split.json", "{}");
    place.run("data export dataset --format colmap --split split.json --out x -q").refused("triplets", "");
}
