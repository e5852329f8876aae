//! Pickles that no training program writes.

use super::*;
use proptest::prelude::*;

/// Writes pickles opcode by opcode.
struct Pickle(Vec<u8>);

impl Pickle {
    fn new() -> Self {
        Self(vec![0x80, 2])
    }

    fn op(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }

    fn name(self, module: &str, name: &str) -> Self {
        self.op(format!("c{module}\n{name}\n").as_bytes())
    }

    fn text(self, text: &str) -> Self {
        self.op(b"X").op(&(text.len() as u32).to_le_bytes()).op(text.as_bytes())
    }

    fn int(self, value: i64) -> Self {
        self.op(&[0x8a, 8]).op(&value.to_le_bytes())
    }

    fn storage(self, class: &str, key: &str, len: i64) -> Self {
        self.op(b"(").text("storage").name("torch", class).text(key).text("cuda:3").int(len).op(b"tQ")
    }

    fn tensor(self, len: i64, offset: i64, shape: &[i64], strides: &[i64]) -> Self {
        let mut pickle =
            self.name("torch._utils", "_rebuild_tensor_v2").op(b"(").storage("FloatStorage", "0", len);
        pickle = pickle.int(offset);
        for sizes in [shape, strides] {
            pickle = sizes.iter().fold(pickle.op(b"("), |pickle, size| pickle.int(*size)).op(b"t");
        }
        pickle.op(b"\x89").name("collections", "OrderedDict").op(b")RtR")
    }

    fn load(self) -> Result<Objects, Fault> {
        load(&self.op(b".").0)
    }
}

fn refusal(pickle: Pickle) -> String {
    match pickle.load() {
        Err(Fault::Refused { found, .. }) => found,
        other => panic!("{other:?}"),
    }
}

fn is_wrong(pickle: Pickle) -> bool {
    matches!(pickle.load(), Err(Fault::Wrong { .. }))
}

#[test]
fn callables_are_refused_by_name() {
    let names = [
        ("os", "system"),
        ("builtins", "eval"),
        ("torch", "load"),
        ("collections", "Counter"),
        ("torch", "FloatStorage2"),
    ];
    for (module, name) in names {
        let attack = Pickle::new().name(module, name).op(b"(").text("id > owned").op(b"tR");
        assert_eq!(refusal(attack), format!("{module}.{name}"));
    }
    let through_newobj = Pickle::new().name("subprocess", "Popen").op(b"(").text("id").op(b"t\x81");
    assert_eq!(refusal(through_newobj), "subprocess.Popen");
    // The old opcodes that look a class up by themselves, and those of extension registries.
    for opcode in [b"i".as_slice(), b"o", b"\x82\x01", b"\x93", b"P0\n", b"\x92", b"\x95"] {
        assert!(matches!(Pickle::new().op(b"(").op(opcode).load(), Err(Fault::Refused { .. })), "{opcode:?}");
    }
    assert!(refusal(Pickle::new().op(&[0x80, 4])).contains('4'));
}

#[test]
fn known_names_do_nothing_but_build() {
    assert!(is_wrong(Pickle::new().name("collections", "OrderedDict").op(b"((t").op(b"tR")));
    let storage = Pickle::new().name("torch", "FloatStorage").op(b"(").int(1 << 40).op(b"tR");
    assert_eq!(refusal(storage), "a storage class");
    let scalar = Pickle::new().name("numpy.core.multiarray", "scalar").op(b"(").text("f8").op(b"tR").load();
    assert_eq!(*scalar.unwrap().root(), Object::Opaque("numpy scalar"));
}

#[test]
fn tensors_lie_in_their_storages() {
    let good = Pickle::new().tensor(12, 0, &[3, 4], &[4, 1]).load().unwrap();
    assert!(matches!(good.root(), Object::Tensor(tensor) if tensor.shape == [3, 4]));
    assert!(Pickle::new().tensor(12, 0, &[4, 3], &[1, 4]).load().is_ok(), "transposed");
    assert!(Pickle::new().tensor(12, 0, &[0, 5], &[5, 1]).load().is_ok(), "empty");
    let broken: [(i64, i64, &[i64], &[i64]); 9] = [
        (12, 1, &[3, 4], &[4, 1]),
        (12, 0, &[3, 5], &[4, 1]),
        (12, -1, &[3], &[1]),
        (12, 0, &[-3], &[1]),
        (12, 0, &[3], &[-1]),
        (1, 0, &[1 << 40, 1 << 40], &[0, 0]),
        (i64::MAX, i64::MAX, &[2, 2], &[i64::MAX, i64::MAX]),
        (12, 0, &[3], &[]),
        (12, 0, &[1; 9], &[1; 9]),
    ];
    for (len, offset, shape, strides) in broken {
        assert!(is_wrong(Pickle::new().tensor(len, offset, shape, strides)), "{shape:?} {strides:?}");
    }
    assert!(is_wrong(Pickle::new().storage("FloatStorage", "0", -1)));
    assert!(is_wrong(Pickle::new().storage("FloatStorage", &"0".repeat(99), 1)));
}

#[test]
fn machines_that_run_empty_say_so() {
    for opcodes in
        [b"0".as_slice(), b"R", b"b", b"Q", b"a", b"s", b"t", b"\x87", b"2", b"q\0", b"h\x07", b"(0", b"}(Nu"]
    {
        assert!(is_wrong(Pickle::new().op(opcodes)), "{opcodes:?}");
    }
    assert_eq!(load(&[0x80]).unwrap_err(), Fault::Cut);
    assert_eq!(load(b"\x80\x02X\xff\xff\xff\xffa").unwrap_err(), Fault::Cut);
    assert!(is_wrong(Pickle::new().op(b"]N]a").op(b"}Na")));
}

#[test]
fn a_state_is_built_into_one_object_only() {
    // A dictionary remembered and built into many namespaces would multiply its items.
    let mut pickle = Pickle::new().op(b"}q\x00").text("a").text("b").op(b"s");
    for _ in 0..3 {
        pickle = pickle.name("argparse", "Namespace").op(b")\x81h\x00b");
    }
    let objects = pickle.op(b"\x87").load().unwrap();
    let filled =
        objects.arena.iter().filter(|object| matches!(object, Object::Dict(items) if !items.is_empty()));
    assert_eq!(filled.count(), 1);
}

#[test]
fn a_list_in_itself_neither_leaks_nor_recurses() {
    let objects = Pickle::new().op(b"]q\x00h\x00a").load().unwrap();
    assert!(matches!(objects.root(), Object::List(list) if list.len() == 1));
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = load(&bytes);
    }

    #[test]
    fn no_opcodes_make_it_panic(opcodes in prop::collection::vec(
        prop::sample::select(b"(01NJKMX}])tuseabRQqhc.\x81\x85\x86\x87\x88\x89\x8aG2U".to_vec()), 0..120)
    ) {
        let _ = load(&opcodes);
    }
}
