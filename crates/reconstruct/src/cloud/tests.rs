use super::*;

/// Three points far from the map's zero.
fn sample() -> Cloud {
    let point = |i: usize, view: u8| CloudPoint {
        position: [1.5 + i as f32, -20.25, 300.0 * i as f32],
        color: [10 * i as u8, 255, 7],
        view,
        fill: 1 + (i % 2) as u8,
        confidence: 0.25 * i as f32,
        sigma: if i == 1 { f32::NAN } else { 0.125 },
    };
    Cloud {
        origin: [52_900.0, -14_700.0, -1200.0],
        points: vec![point(0, 0), point(1, 0), point(2, 1)],
        metric: true,
        frame: "map".to_owned(),
        wkt: Some("PROJCS[]".to_owned()),
    }
}

fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

#[test]
fn ply_holds_what_its_header_says() {
    let cloud = sample();
    let bytes = ply::encode(&cloud);
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(header.contains("comment origin 52900 -14700 -1200 "));
    assert!(header.contains("element vertex 3\n"));
    let sizes = |kind: &str, size| header.matches(&format!("property {kind} ")).count() * size;
    assert_eq!(sizes("float", 4) + sizes("uchar", 1), ply::POINT_BYTES);
    assert_eq!(bytes.len(), end + 3 * ply::POINT_BYTES);
    let last = &bytes[end + 2 * ply::POINT_BYTES..];
    assert_eq!([f32_at(last, 0), f32_at(last, 4), f32_at(last, 8)], [3.5, -20.25, 600.0]);
    assert_eq!(last[12..17], [20, 255, 7, 1, 1]);
    assert_eq!([f32_at(last, 17), f32_at(last, 21)], [0.5, 0.125]);
}

#[test]
fn las_points_lie_where_scale_and_offset_put_them() {
    let cloud = sample();
    let bytes = las::encode(&cloud);
    assert_eq!(&bytes[..4], b"LASF");
    assert_eq!([bytes[24], bytes[25], bytes[104]], [1, 4, 7]);
    let (offset, length) = (u32_at(&bytes, 96), u16::from_le_bytes([bytes[105], bytes[106]]) as usize);
    assert_eq!(bytes.len(), offset + 3 * length);
    assert_eq!(u64::from_le_bytes(bytes[247..255].try_into().unwrap()), 3);
    for (i, point) in cloud.points.iter().enumerate() {
        let record = &bytes[offset + i * length..][..length];
        for axis in 0..3 {
            let whole = u32_at(record, 4 * axis) as u32 as i32;
            let scale = f64_at(&bytes, 131 + 8 * axis);
            let value = f64::from(whole) * scale + f64_at(&bytes, 155 + 8 * axis);
            let expected = f64::from(point.position[axis]) + cloud.origin[axis];
            assert!((value - expected).abs() <= 0.5 * scale, "{value} {expected}");
            // Bounds come as (largest, smallest) for x, y, z.
            let bounds = [f64_at(&bytes, 179 + 16 * axis), f64_at(&bytes, 187 + 16 * axis)];
            assert!(bounds[1] <= value && value <= bounds[0]);
        }
        assert_eq!(record[17], point.view);
        assert_eq!(record[15], u8::from(point.fill == 2));
        assert_eq!(f32_at(record, 36), point.confidence);
        assert_eq!(f32_at(record, 40).is_nan(), point.sigma.is_nan());
    }
}

#[test]
fn las_scales_follow_the_extent() {
    for (extent, scale) in [(1e4f32, 1e-3), (1.0, 1e-7), (3e7, 1e-1)] {
        let mut cloud = sample();
        cloud.points[0].position = [extent, 0.0, 0.0];
        for point in &mut cloud.points[1..] {
            point.position = [0.0; 3];
        }
        let found = f64_at(&las::encode(&cloud), 131);
        assert!((found / scale - 1.0).abs() < 1e-9, "{extent}: {found}");
    }
}

#[test]
fn glb_is_a_header_json_and_binary() {
    let cloud = sample();
    let bytes = glb::encode(&cloud);
    assert_eq!(&bytes[..4], b"glTF");
    assert_eq!(u32_at(&bytes, 8), bytes.len());
    let json_bytes = u32_at(&bytes, 12);
    assert_eq!(json_bytes % 4, 0);
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + json_bytes]).unwrap();
    assert_eq!(json["asset"]["extras"]["origin_x_y_height"][0], 52_900.0);
    let binary = &bytes[20 + json_bytes + 8..];
    assert_eq!(json["buffers"][0]["byteLength"], binary.len());
    let stride = json["bufferViews"][0]["byteStride"].as_u64().unwrap() as usize;
    // Y is up: (x, height, −y).
    assert_eq!(
        [f32_at(binary, stride), f32_at(binary, stride + 4), f32_at(binary, stride + 8)],
        [2.5, 300.0, 20.25]
    );
    let accessors = json["accessors"].as_array().unwrap();
    assert_eq!(accessors[0]["max"], serde_json::json!([3.5, 600.0, 20.25]));
    let sigma = accessors[3]["byteOffset"].as_u64().unwrap() as usize;
    assert_eq!([f32_at(binary, sigma), f32_at(binary, stride + sigma)], [0.125, -1.0]);
}

#[test]
fn views_are_red_and_green() {
    let (a, b) = (color(Coloring::Views, 0, 0.0), color(Coloring::Views, 1, 1.0));
    assert!(a[0] > 100 && a[1] < 50 && b[1] > 200 && b[0] < 50);
    assert_eq!(color(Coloring::Picture, 1, 0.4), [102; 3]);
    assert_eq!(color(Coloring::Picture, 0, f32::NAN), [128; 3]);
}
