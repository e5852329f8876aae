//! Files that are damaged or mean harm: an error that says what, never a panic, never a memory of their choice.

use crate::torch_file::{Tensor, Zip, archive, pickle};
use proptest::prelude::*;
use selenograph_network::{Checkpoint, Error};
use std::path::PathBuf;

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join("checkpoint");
        std::fs::write(&path, bytes).unwrap();
        path
    }

    fn error(&self, bytes: &[u8]) -> Error {
        Checkpoint::open(&self.write(bytes)).unwrap_err()
    }
}

/// A norm of the encoder, so that there is something to be read.
fn honest() -> Zip {
    let tensors = [Tensor::new("enc_blocks.0.norm1.weight", "FloatStorage", "0", &[64])];
    archive(pickle(None, &tensors), &[("0", vec![0; 256])])
}

#[test]
fn code_in_a_pickle_is_refused_and_named() {
    let place = Place::new();
    let attack = b"\x80\x02cposix\nsystem\nX\x08\0\0\0touch ow\x85R.".to_vec();
    let error = place.error(&archive(attack, &[]).bytes());
    assert!(matches!(error, Error::Refused { .. }), "{error}");
    assert!(error.to_string().contains("posix.system"), "{error}");
    assert!(error.hint().unwrap().contains("nothing in it was run"));
}

#[test]
fn compressed_lying_and_overlapping_entries_are_refused() {
    let place = Place::new();
    let deflated = Zip { method: 8, ..honest() };
    assert!(matches!(place.error(&deflated.bytes()), Error::Refused { .. }));
    let lying = Zip { lie: 1 << 30, ..honest() };
    assert!(matches!(place.error(&lying.bytes()), Error::Refused { .. }));
    let mut twice = honest();
    twice.entries.push(twice.entries[0].clone());
    assert!(matches!(place.error(&twice.bytes()), Error::Refused { .. }));
    // Eight directory entries that all point at the first one's bytes.
    let many = Zip {
        entries: (0..8)
            .map(|i| (format!("model/data/{i}"), vec![0; if i == 0 { 4096 } else { 0 }]))
            .collect(),
        ..Zip::default()
    };
    let mut bytes = many.bytes();
    let signature = 0x0201_4b50u32.to_le_bytes();
    let starts: Vec<usize> = (0..bytes.len() - 4).filter(|&at| bytes[at..at + 4] == signature).collect();
    let [first_sizes, first_start] =
        [20..28, 42..46].map(|r| bytes[starts[0] + r.start..starts[0] + r.end].to_vec());
    for start in starts {
        bytes[start + 20..start + 28].copy_from_slice(&first_sizes);
        bytes[start + 42..start + 46].copy_from_slice(&first_start);
    }
    let error = place.error(&bytes);
    assert!(error.to_string().contains("overlap"), "{error}");
}

#[test]
fn storages_have_the_size_that_is_told() {
    let place = Place::new();
    let claims: [(&str, usize, &[usize]); 4] = [
        ("FloatStorage", 1 << 40, &[1 << 40]),
        ("DoubleStorage", 64, &[64]),
        ("FloatStorage", usize::MAX / 4, &[64]),
        ("HalfStorage", 64, &[64]),
    ];
    for (class, storage_len, shape) in claims {
        let tensor = Tensor { storage_len, ..Tensor::new("enc_blocks.0.norm1.weight", class, "0", shape) };
        let error = place.error(&archive(pickle(None, &[tensor]), &[("0", vec![0; 256])]).bytes());
        assert!(matches!(error, Error::Malformed { .. }), "{class} {storage_len}: {error}");
    }
    let absent = Tensor::new("enc_blocks.0.norm1.weight", "FloatStorage", "../../0", &[64]);
    let error = place.error(&archive(pickle(None, &[absent]), &[("0", vec![0; 256])]).bytes());
    assert!(error.to_string().contains("storage"), "{error}");
}

#[test]
fn model_strings_cannot_ask_for_a_network_without_end() {
    let place = Place::new();
    let tensors = [Tensor::new("enc_norm.weight", "FloatStorage", "0", &[64])];
    let model = "AsymmetricMASt3R(enc_embed_dim=64, enc_depth=1000000, enc_num_heads=1, dec_embed_dim=64, \
        dec_depth=12, dec_num_heads=1, output_mode='pts3d+desc24', patch_size=16)";
    let error = place.error(&archive(pickle(Some(model), &tensors), &[("0", vec![0; 256])]).bytes());
    assert!(matches!(error, Error::Config { .. }), "{error}");
    let error = place.error(&archive(pickle(Some("Evil(x=1)"), &tensors), &[("0", vec![0; 256])]).bytes());
    assert!(matches!(error, Error::ModelString { .. }), "{error}");
    let names = [Tensor::new("enc_blocks.18446744073709551615.norm1.weight", "FloatStorage", "0", &[64])];
    assert!(
        Checkpoint::open(&place.write(&archive(pickle(None, &names), &[("0", vec![0; 256])]).bytes()))
            .is_err()
    );
}

#[test]
fn other_files_say_what_they_are() {
    let place = Place::new();
    assert!(place.error(b"").to_string().contains("empty"));
    assert!(place.error(b"version https://git-lfs.github.com/spec/v1\n").to_string().contains("Git LFS"));
    assert!(place.error(b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.").to_string().contains("1.6"));
    assert!(place.error(&[7; 100]).to_string().contains("other bytes"));
    let folder = Checkpoint::open(place.0.path()).unwrap_err();
    assert!(folder.to_string().contains("folder"), "{folder}");
    assert!(matches!(Checkpoint::open(&place.0.path().join("none")), Err(Error::Io { .. })));
    let other = Zip { entries: vec![("word/document.xml".into(), vec![1, 2, 3])], ..Zip::default() };
    assert!(matches!(place.error(&other.bytes()), Error::NotACheckpoint { .. }));
    let strangers = [Tensor::new("conv1.weight", "FloatStorage", "0", &[64])];
    let error = place.error(&archive(pickle(None, &strangers), &[("0", vec![0; 256])]).bytes());
    assert!(matches!(error, Error::NotACheckpoint { .. }), "{error}");
}

#[test]
fn every_truncation_is_an_error() {
    let place = Place::new();
    for bytes in [honest().bytes(), Zip { wide: true, ..honest() }.bytes(), safetensors("{}", 0)] {
        for len in 0..bytes.len() {
            assert!(Checkpoint::open(&place.write(&bytes[..len])).is_err(), "{len} of {}", bytes.len());
        }
    }
}

fn safetensors(header: &str, data: usize) -> Vec<u8> {
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend_from_slice(header.as_bytes());
    bytes.resize(bytes.len() + data, 0);
    bytes
}

#[test]
fn hostile_safetensors_are_refused() {
    let place = Place::new();
    let tensor = |shape: &str, dtype: &str, offsets: &str| {
        format!(r#"{{"enc_norm.weight":{{"dtype":"{dtype}","shape":{shape},"data_offsets":{offsets}}}}}"#)
    };
    let cases = [
        (tensor("[4]", "F32", "[0,12]"), "bytes"),
        (tensor("[4]", "F32", "[16,0]"), "bytes"),
        (tensor("[4]", "F4", "[0,16]"), "BF16"),
        (tensor("[4]", "F32", "[16,32]"), "truncated"),
        (tensor("[4294967296,4294967296]", "F32", "[0,0]"), "bytes"),
        (tensor("[-1]", "F32", "[0,4]"), "JSON"),
        (r#"{"a":{"dtype":"F32","shape":[2],"data_offsets":[0,8]},"b":{"dtype":"F32","shape":[2],"data_offsets":[4,12]}}"#.into(), "of its own"),
        ("{".repeat(100_000), "JSON"),
    ];
    for (header, says) in cases {
        let error = place.error(&safetensors(&header, 16)).to_string();
        assert!(error.contains(says), "{says}: {error}");
    }
    let mut long = safetensors("{}", 64);
    long[..8].copy_from_slice(&(1u64 << 40).to_le_bytes());
    assert!(matches!(place.error(&long), Error::Refused { .. }));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_change_of_a_byte_makes_it_panic(at in any::<prop::sample::Index>(), value in any::<u8>(), wide in any::<bool>()) {
        let place = Place::new();
        let mut bytes = Zip { wide, ..honest() }.bytes();
        let at = at.index(bytes.len());
        bytes[at] = value;
        if let Ok(checkpoint) = Checkpoint::open(&place.write(&bytes)) {
            let _ = checkpoint.read("enc_blocks.0.norm1.weight");
        }
    }

    #[test]
    fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), kind in 0usize..3) {
        let place = Place::new();
        let start: [&[u8]; 3] = [b"PK\x03\x04", b"", b"\x40\0\0\0\0\0\0\0{"];
        let _ = Checkpoint::open(&place.write(&[start[kind], &bytes].concat()));
    }
}
