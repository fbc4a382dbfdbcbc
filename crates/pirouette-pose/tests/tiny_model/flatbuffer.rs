//! A writer of FlatBuffers, for tests

/// Table: slots and values
pub(crate) type Table = Vec<(usize, Value)>;

/// Value of a field
#[derive(Clone, Debug)]
pub(crate) enum Value {
    Byte(u8),
    Int(i32),
    Table(Table),
    Tables(Vec<Table>),
    Ints(Vec<i32>),
    Bytes(Vec<u8>),
}

/// Writes a file with an identifier; what is reached first is written first.
pub(crate) fn write(root: &Table, identifier: [u8; 4]) -> Vec<u8> {
    let mut out = vec![0; 4];
    out.extend(identifier);
    let at = write_table(&mut out, root);
    out[..4].copy_from_slice(&(at as u32).to_le_bytes());
    out
}

/// Writes the table of offsets, the table and then what it refers to; returns the place of the table.
fn write_table(out: &mut Vec<u8>, table: &Table) -> usize {
    let slots = table.iter().map(|(slot, _)| slot + 1).max().unwrap_or(0);
    let vtable = out.len();
    let len = 4 + 4 * table.len();
    out.extend((4 + 2 * slots as u16).to_le_bytes());
    out.extend((len as u16).to_le_bytes());
    for slot in 0..slots {
        let field = table
            .iter()
            .position(|(s, _)| *s == slot)
            .map_or(0, |i| 4 + 4 * i);
        out.extend((field as u16).to_le_bytes());
    }
    let at = out.len();
    out.extend(((at - vtable) as i32).to_le_bytes());
    out.resize(at + len, 0);
    for (i, (_, value)) in table.iter().enumerate() {
        let place = at + 4 + 4 * i;
        match value {
            Value::Byte(v) => out[place] = *v,
            Value::Int(v) => out[place..place + 4].copy_from_slice(&v.to_le_bytes()),
            other => {
                let target = write_reference(out, other);
                set_offset(out, place, target);
            }
        }
    }
    at
}

fn write_reference(out: &mut Vec<u8>, value: &Value) -> usize {
    if let Value::Table(table) = value {
        return write_table(out, table);
    }
    let at = out.len();
    let mut write_len = |len: usize| out.extend((len as u32).to_le_bytes());
    match value {
        Value::Ints(values) => {
            write_len(values.len());
            values.iter().for_each(|v| out.extend(v.to_le_bytes()));
        }
        Value::Bytes(values) => {
            write_len(values.len());
            out.extend(values);
        }
        Value::Tables(tables) => {
            write_len(tables.len());
            out.resize(at + 4 + 4 * tables.len(), 0);
            for (i, table) in tables.iter().enumerate() {
                let target = write_table(out, table);
                set_offset(out, at + 4 + 4 * i, target);
            }
        }
        Value::Byte(_) | Value::Int(_) | Value::Table(_) => unreachable!("not stored by reference"),
    }
    at
}

fn set_offset(out: &mut [u8], place: usize, target: usize) {
    out[place..place + 4].copy_from_slice(&((target - place) as u32).to_le_bytes());
}
