//! The pickle machine: a stack, a memo, and opcodes that only build data.

use super::Fault;
use super::objects::{Id, Name, Object, Objects, Storage, Tensor};
use std::collections::HashMap;

/// Tensors have no more sides than this.
const MAX_SIDES: usize = 8;
/// Nothing that is built here takes more arguments than this.
const MAX_ARGUMENTS: usize = 16;
/// Keys of storages are small numbers.
const MAX_KEY: usize = 32;

/// Reads a pickle.
///
/// # Errors
/// [`Fault`]; nothing that a pickle holds can make it panic, recurse or take more memory than a fixed multiple of its size.
pub fn load(bytes: &[u8]) -> Result<Objects, Fault> {
    let mut machine = Machine {
        rest: bytes,
        arena: Vec::new(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: HashMap::new(),
    };
    loop {
        let [opcode] = machine.take()?;
        if opcode == b'.' {
            let root = machine.pop()?;
            return Ok(Objects { arena: machine.arena, root });
        }
        machine.step(opcode)?;
    }
}

struct Machine<'a> {
    rest: &'a [u8],
    arena: Vec<Object>,
    stack: Vec<Id>,
    marks: Vec<usize>,
    memo: HashMap<u32, Id>,
}

impl Machine<'_> {
    fn step(&mut self, opcode: u8) -> Result<(), Fault> {
        match opcode {
            0x80 => self.protocol(),
            b'(' => {
                self.marks.push(self.stack.len());
                Ok(())
            }
            b'0' => self.pop().map(|_| ()),
            b'1' => self.pop_to_mark().map(|_| ()),
            b'2' => {
                let top = self.top()?;
                self.stack.push(top);
                Ok(())
            }
            b'q' | b'r' | b'h' | b'j' => self.memo(opcode),
            b'c' => self.name(),
            b'R' | 0x81 => self.apply(),
            b'b' => self.build(),
            b'Q' => self.persistent(),
            b'a' | b'e' => self.append(opcode == b'e'),
            b's' | b'u' => self.set_items(opcode == b'u'),
            _ => {
                let object = self.literal(opcode)?;
                self.push(object)
            }
        }
    }

    fn protocol(&mut self) -> Result<(), Fault> {
        match self.take()? {
            [2] => Ok(()),
            [other] => Err(Fault::refused("its pickle has the protocol", other.to_string())),
        }
    }

    fn memo(&mut self, opcode: u8) -> Result<(), Fault> {
        let key = if matches!(opcode, b'q' | b'h') {
            u32::from(self.take::<1>()?[0])
        } else {
            u32::from_le_bytes(self.take()?)
        };
        if matches!(opcode, b'q' | b'r') {
            let top = self.top()?;
            self.memo.insert(key, top);
        } else {
            let id = self.memo.get(&key);
            let id = *id.ok_or_else(|| Fault::wrong("a remembered object", format!("number {key}")))?;
            self.stack.push(id);
        }
        Ok(())
    }

    /// Numbers, texts, tuples, empty containers.
    fn literal(&mut self, opcode: u8) -> Result<Object, Fault> {
        Ok(match opcode {
            b'N' => Object::None,
            0x88 => Object::Bool(true),
            0x89 => Object::Bool(false),
            b'J' => Object::Int(i64::from(i32::from_le_bytes(self.take()?))),
            b'K' => Object::Int(i64::from(self.take::<1>()?[0])),
            b'M' => Object::Int(i64::from(u16::from_le_bytes(self.take()?))),
            0x8a => self.long()?,
            b'G' => Object::Float(f64::from_be_bytes(self.take()?)),
            b'X' | b'T' => {
                let len = u32::from_le_bytes(self.take()?);
                self.text(len as usize)?
            }
            b'U' => {
                let [len] = self.take()?;
                self.text(usize::from(len))?
            }
            b'}' => Object::Dict(Vec::new()),
            b']' => Object::List(Vec::new()),
            b')' => Object::Tuple(Vec::new()),
            b't' => Object::Tuple(self.pop_to_mark()?),
            0x85..=0x87 => {
                let len = usize::from(opcode - 0x84);
                let start = self.stack.len().checked_sub(len);
                let start = start.filter(|start| *start >= self.floor());
                Object::Tuple(self.stack.split_off(start.ok_or_else(|| Fault::wrong("an object", "none"))?))
            }
            _ => return Err(Fault::refused("its pickle has the opcode", describe(opcode))),
        })
    }

    fn long(&mut self) -> Result<Object, Fault> {
        let [len] = self.take()?;
        let bytes = self.slice(usize::from(len))?;
        if bytes.len() > 8 {
            // Random states and serial numbers; nothing that describes a network.
            return Ok(Object::Opaque("long integer"));
        }
        let fill = if bytes.last().is_some_and(|high| high & 0x80 != 0) { 0xff } else { 0 };
        let mut wide = [fill; 8];
        wide[..bytes.len()].copy_from_slice(bytes);
        Ok(Object::Int(i64::from_le_bytes(wide)))
    }

    fn text(&mut self, len: usize) -> Result<Object, Fault> {
        let bytes = self.slice(len)?;
        // Python lets a half of a surrogate pair pass, which no name here has.
        let text = std::str::from_utf8(bytes).map_err(|_| Fault::wrong("a text in UTF-8", "other bytes"))?;
        Ok(Object::Text(text.to_owned()))
    }

    fn name(&mut self) -> Result<(), Fault> {
        let mut line = || -> Result<String, Fault> {
            let end = self.rest.iter().position(|byte| *byte == b'\n').ok_or(Fault::Cut)?;
            let text = String::from_utf8_lossy(&self.rest[..end]).into_owned();
            self.rest = &self.rest[end + 1..];
            Ok(text)
        };
        let (module, name) = (line()?, line()?);
        let known = Name::of(&module, &name).ok_or_else(|| {
            let full: String = format!("{module}.{name}").chars().take(120).collect();
            Fault::refused("its pickle names", full.escape_default().to_string())
        })?;
        self.push(Object::Name(known))
    }

    /// `REDUCE` and `NEWOBJ`: a name applied to a tuple.
    fn apply(&mut self) -> Result<(), Fault> {
        let (arguments, callee) = (self.pop()?, self.pop()?);
        let Object::Name(name) = *self.object(callee) else {
            return Err(Fault::wrong("a name before its arguments", kind(self.object(callee))));
        };
        let arguments = match self.object(arguments) {
            Object::Tuple(arguments) if arguments.len() <= MAX_ARGUMENTS => arguments.clone(),
            other => return Err(Fault::wrong("a short tuple of arguments", kind(other))),
        };
        let object = match name {
            Name::OrderedDict | Name::Namespace if arguments.is_empty() => Object::Dict(Vec::new()),
            Name::Namespace => return Err(Fault::wrong("no arguments of a namespace", "some")),
            Name::OrderedDict => return Err(Fault::wrong("no arguments of an OrderedDict", "some")),
            Name::RebuildTensor => Object::Tensor(Box::new(self.tensor(&arguments)?)),
            Name::RebuildParameter => match arguments.first().map(|id| self.object(*id)) {
                Some(tensor @ Object::Tensor(_)) => tensor.clone(),
                _ => return Err(Fault::wrong("a tensor in a parameter", "something else")),
            },
            Name::StorageOf(_) => return Err(Fault::refused("its pickle calls", "a storage class")),
            Name::Inert(what) => Object::Opaque(what),
        };
        self.push(object)
    }

    /// `BUILD`: attributes of the object below.
    fn build(&mut self) -> Result<(), Fault> {
        let (state, target) = (self.pop()?, self.top()?);
        // Taken, not copied: a state that were built into many objects would multiply.
        let attributes = match self.object_mut(state) {
            Object::Dict(attributes) => std::mem::take(attributes),
            other => {
                let found = kind(other);
                return match self.object(target) {
                    Object::Opaque(_) => Ok(()),
                    _ => Err(Fault::wrong("a dictionary of attributes", found)),
                };
            }
        };
        // A namespace's attributes are its items; an OrderedDict has its items by now, and its attributes (`_metadata`)
        // say nothing about tensors.
        let metadata = |id: &Id| matches!(self.object(*id), Object::Text(text) if text == "_metadata");
        if attributes.iter().any(|(key, _)| metadata(key)) {
            return Ok(());
        }
        match self.object_mut(target) {
            Object::Dict(items) if items.is_empty() => *items = attributes,
            Object::Dict(_) | Object::Opaque(_) => {}
            other => return Err(Fault::wrong("a namespace to fill", kind(other))),
        }
        Ok(())
    }

    /// `('storage', class, key, device, length)`; the device does not matter.
    fn persistent(&mut self) -> Result<(), Fault> {
        let id = self.pop()?;
        let expected = "('storage', class, key, device, length)";
        let Object::Tuple(parts) = self.object(id) else {
            return Err(Fault::wrong(expected, kind(self.object(id))));
        };
        let parts: Vec<&Object> = parts.iter().map(|id| self.object(*id)).collect();
        let storage = match parts[..] {
            [
                Object::Text(tag),
                Object::Name(Name::StorageOf(kind)),
                Object::Text(key),
                Object::Text(_) | Object::None,
                Object::Int(len),
            ] if tag == "storage" && *len >= 0 && key.len() <= MAX_KEY => {
                Box::new(Storage { key: key.clone(), kind: *kind, len: len.unsigned_abs() })
            }
            _ => return Err(Fault::wrong(expected, "another tuple")),
        };
        self.push(Object::Storage(storage))
    }

    /// `(storage, offset, size, stride, requires_grad, hooks)`.
    fn tensor(&self, arguments: &[Id]) -> Result<Tensor, Fault> {
        let expected = "(storage, offset, size, stride, …) of a tensor";
        let parts: Vec<&Object> = arguments.iter().map(|id| self.object(*id)).collect();
        let [Object::Storage(storage), Object::Int(offset), Object::Tuple(size), Object::Tuple(stride), ..] =
            parts[..]
        else {
            return Err(Fault::wrong(expected, "other arguments"));
        };
        if size.len() != stride.len() || size.len() > MAX_SIDES {
            let found = format!("{} sides with {} strides", size.len(), stride.len());
            return Err(Fault::wrong("as many strides as sides, at most 8", found));
        }
        let tensor = Tensor {
            storage: Storage::clone(storage),
            offset: u64::try_from(*offset)
                .map_err(|_| Fault::wrong("an offset from 0 on", offset.to_string()))?,
            shape: self.sizes(size)?.into_iter().map(|size| size as usize).collect(),
            strides: self.sizes(stride)?,
        };
        check_extent(&tensor)?;
        Ok(tensor)
    }

    fn sizes(&self, ids: &[Id]) -> Result<Vec<u64>, Fault> {
        let size = |id: &Id| match self.object(*id) {
            Object::Int(size) => u64::try_from(*size).ok().filter(|size| usize::try_from(*size).is_ok()),
            _ => None,
        };
        ids.iter()
            .map(|id| size(id).ok_or_else(|| Fault::wrong("a size from 0 on", kind(self.object(*id)))))
            .collect()
    }

    fn append(&mut self, many: bool) -> Result<(), Fault> {
        let values = if many { self.pop_to_mark()? } else { vec![self.pop()?] };
        let target = self.top()?;
        match self.object_mut(target) {
            Object::List(list) => list.extend(values),
            other => return Err(Fault::wrong("a list to append to", kind(other))),
        }
        Ok(())
    }

    fn set_items(&mut self, many: bool) -> Result<(), Fault> {
        let flat = if many {
            self.pop_to_mark()?
        } else {
            let (value, key) = (self.pop()?, self.pop()?);
            vec![key, value]
        };
        let (pairs, left_over) = flat.as_chunks::<2>();
        if !left_over.is_empty() {
            return Err(Fault::wrong("a value for each key", "a key without one"));
        }
        let target = self.top()?;
        match self.object_mut(target) {
            Object::Dict(items) => items.extend(pairs.iter().map(|[key, value]| (*key, *value))),
            other => return Err(Fault::wrong("a dictionary to fill", kind(other))),
        }
        Ok(())
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let (taken, rest) = self.rest.split_first_chunk::<N>().ok_or(Fault::Cut)?;
        self.rest = rest;
        Ok(*taken)
    }

    fn slice(&mut self, len: usize) -> Result<&[u8], Fault> {
        let (taken, rest) = self.rest.split_at_checked(len).ok_or(Fault::Cut)?;
        self.rest = rest;
        Ok(taken)
    }

    fn push(&mut self, object: Object) -> Result<(), Fault> {
        let id = u32::try_from(self.arena.len()).map_err(|_| Fault::wrong("fewer objects", "too many"))?;
        self.arena.push(object);
        self.stack.push(Id(id));
        Ok(())
    }

    /// Objects below the innermost mark belong to whoever set it.
    fn floor(&self) -> usize {
        self.marks.last().copied().unwrap_or(0)
    }

    fn pop(&mut self) -> Result<Id, Fault> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    fn top(&self) -> Result<Id, Fault> {
        let above = self.stack.get(self.floor()..).and_then(<[Id]>::last);
        above.copied().ok_or_else(|| Fault::wrong("an object", "none"))
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Id>, Fault> {
        let mark = self.marks.pop().ok_or_else(|| Fault::wrong("a mark", "none"))?;
        // Nothing is popped from below a mark, so it still lies on the stack.
        Ok(self.stack.split_off(mark.min(self.stack.len())))
    }

    fn object(&self, id: Id) -> &Object {
        &self.arena[id.0 as usize]
    }

    fn object_mut(&mut self, id: Id) -> &mut Object {
        &mut self.arena[id.0 as usize]
    }
}

/// A tensor lies in its storage and has no more elements than it: none is blown up by strides of zero.
fn check_extent(tensor: &Tensor) -> Result<(), Fault> {
    let total = tensor.shape.iter().try_fold(1u64, |total, size| total.checked_mul(*size as u64));
    let total = total.filter(|total| *total <= tensor.storage.len).ok_or_else(|| {
        let expected = format!("a tensor within its storage of {} elements", tensor.storage.len);
        Fault::wrong(expected, format!("sizes {:?}", tensor.shape))
    })?;
    if total == 0 {
        return Ok(());
    }
    let last = tensor.shape.iter().zip(&tensor.strides).try_fold(tensor.offset, |last, (size, stride)| {
        last.checked_add(stride.checked_mul(*size as u64 - 1)?)
    });
    match last {
        Some(last) if last < tensor.storage.len => Ok(()),
        _ => {
            let expected = format!("a tensor within its storage of {} elements", tensor.storage.len);
            let found =
                format!("sizes {:?}, strides {:?} from {}", tensor.shape, tensor.strides, tensor.offset);
            Err(Fault::wrong(expected, found))
        }
    }
}

fn kind(object: &Object) -> &'static str {
    match object {
        Object::None => "None",
        Object::Bool(_) => "a truth value",
        Object::Int(_) => "an integer",
        Object::Float(_) => "a float",
        Object::Text(_) => "a text",
        Object::Tuple(_) => "a tuple",
        Object::List(_) => "a list",
        Object::Dict(_) => "a dictionary",
        Object::Name(_) => "a name",
        Object::Storage(_) => "a storage",
        Object::Tensor(_) => "a tensor",
        Object::Opaque(what) => what,
    }
}

fn describe(opcode: u8) -> String {
    format!("{opcode:#04x} ({})", char::from(opcode).escape_default())
}
