//! Serialises messages field by field, in the order of the schema: little-endian CDR, ROS 1
//! serialisation, or protobuf.

/// Encoding of the added messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireFormat {
    /// ROS 2
    Cdr,
    /// ROS 1: CDR without encapsulation header, alignment and NUL; a `Header` has a `seq`
    Ros1,
    /// the number of a field is its position in the schema, unless [`Writer::at`] sets it
    Protobuf,
}

/// Serialises one message.
pub struct Writer {
    wire: WireFormat,
    bytes: Vec<u8>,
    /// protobuf field number
    next: u32,
}

/// Wire types of protobuf.
const VARINT: u32 = 0;
const FIXED64: u32 = 1;
const LENGTH_DELIMITED: u32 = 2;
const FIXED32: u32 = 5;

impl Writer {
    /// An empty message; CDR begins with its encapsulation header.
    pub fn new(wire: WireFormat) -> Self {
        let bytes = if wire == WireFormat::Cdr { vec![0, 1, 0, 0] } else { Vec::new() };
        Self { wire, bytes, next: 1 }
    }

    /// Sets protobuf's number of the next field.
    pub fn at(self, number: u32) -> Self {
        Self { next: number, ..self }
    }

    /// Raw bytes, aligned to `size` in CDR.
    fn aligned(mut self, bytes: &[u8], size: usize) -> Self {
        if self.wire == WireFormat::Cdr {
            let position = self.bytes.len() - 4;
            self.bytes.resize(4 + position.next_multiple_of(size), 0);
        }
        self.bytes.extend_from_slice(bytes);
        self
    }

    fn varint(mut self, mut v: u64) -> Self {
        while v >= 0x80 {
            self.bytes.push(v as u8 | 0x80);
            v >>= 7;
        }
        self.bytes.push(v as u8);
        self
    }

    /// protobuf's key: number and wire type of the next field.
    fn key(mut self, wire_type: u32) -> Self {
        let key = u64::from(self.next << 3 | wire_type);
        self.next += 1;
        self.varint(key)
    }

    fn is_protobuf(&self) -> bool {
        self.wire == WireFormat::Protobuf
    }

    /// `uint8`, `bool`; a protobuf enum
    pub fn u8(self, v: u8) -> Self {
        if self.is_protobuf() { self.key(VARINT).varint(v.into()) } else { self.aligned(&[v], 1) }
    }

    /// `uint16`
    pub fn u16(self, v: u16) -> Self {
        if self.is_protobuf() {
            self.key(VARINT).varint(v.into())
        } else {
            self.aligned(&v.to_le_bytes(), 2)
        }
    }

    /// `float32`
    pub fn f32(self, v: f32) -> Self {
        if self.is_protobuf() {
            self.key(FIXED32).aligned(&v.to_le_bytes(), 1)
        } else {
            self.aligned(&v.to_le_bytes(), 4)
        }
    }

    /// `uint32`
    pub fn u32(self, v: u32) -> Self {
        if self.is_protobuf() {
            self.key(VARINT).varint(v.into())
        } else {
            self.aligned(&v.to_le_bytes(), 4)
        }
    }

    /// `uint32`; `fixed32` in protobuf, as in Foxglove's schemas
    pub fn fixed32(self, v: u32) -> Self {
        if self.is_protobuf() {
            self.key(FIXED32).aligned(&v.to_le_bytes(), 1)
        } else {
            self.u32(v)
        }
    }

    /// `float64`
    pub fn f64(self, v: f64) -> Self {
        if self.is_protobuf() {
            self.key(FIXED64).aligned(&v.to_le_bytes(), 1)
        } else {
            self.aligned(&v.to_le_bytes(), 8)
        }
    }

    /// several fields of `float64`
    pub fn f64s(self, values: &[f64]) -> Self {
        values.iter().fold(self, |w, v| w.f64(*v))
    }

    /// `float64[N]`; ROS writes no length
    pub fn f64_array(self, values: &[f64]) -> Self {
        if self.is_protobuf() { self.f64_sequence(values) } else { self.f64s(values) }
    }

    /// `float64[]`
    pub fn f64_sequence(self, values: &[f64]) -> Self {
        if !self.is_protobuf() {
            return self.u32(values.len() as u32).f64s(values);
        }
        let packed = self.key(LENGTH_DELIMITED).varint(8 * values.len() as u64);
        values.iter().fold(packed, |w, v| w.aligned(&v.to_le_bytes(), 1))
    }

    /// `string`
    pub fn text(self, v: &str) -> Self {
        match self.wire {
            WireFormat::Cdr => {
                self.u32(v.len() as u32 + 1).aligned(v.as_bytes(), 1).aligned(&[0], 1)
            }
            WireFormat::Ros1 | WireFormat::Protobuf => self.bytes(v.as_bytes()),
        }
    }

    /// `uint8[]`
    pub fn bytes(self, v: &[u8]) -> Self {
        let counted = if self.is_protobuf() {
            self.key(LENGTH_DELIMITED).varint(v.len() as u64)
        } else {
            self.u32(v.len() as u32)
        };
        counted.aligned(v, 1)
    }

    /// Time: two integers in ROS, a `google.protobuf.Timestamp` in protobuf.
    pub fn time(self, sec: i32, nanosec: u32) -> Self {
        if self.is_protobuf() {
            // Negative seconds are sign-extended, as int64 is.
            let inner = Self::new(WireFormat::Protobuf)
                .key(VARINT)
                .varint(i64::from(sec) as u64)
                .key(VARINT)
                .varint(nanosec.into());
            self.bytes(&inner.finish())
        } else {
            self.aligned(&sec.to_le_bytes(), 4).aligned(&nanosec.to_le_bytes(), 4)
        }
    }

    /// `std_msgs/Header`; in protobuf the fields `timestamp` and `frame_id`. ROS 1's `seq` is 0.
    pub fn header(self, sec: i32, nanosec: u32, frame_id: &str) -> Self {
        let numbered = if self.wire == WireFormat::Ros1 { self.u32(0) } else { self };
        numbered.time(sec, nanosec).text(frame_id)
    }

    /// The serialised message.
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }
}
