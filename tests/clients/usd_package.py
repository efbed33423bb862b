"""A package as zip readers see it: usd_package.py FILE.usdz MEMBER..."""
import struct
import sys
import zipfile

with zipfile.ZipFile(sys.argv[1]) as z:
    assert z.testzip() is None
    assert [i.filename for i in z.infolist()] == sys.argv[2:], z.namelist()
    data = open(sys.argv[1], "rb").read()
    for i in z.infolist():
        assert i.compress_type == zipfile.ZIP_STORED and i.file_size == i.compress_size
        assert i.date_time == (1980, 1, 1, 0, 0, 0), i.date_time
        name, extra = struct.unpack("<HH", data[i.header_offset + 26:i.header_offset + 30])
        start = i.header_offset + 30 + name + extra
        assert start % 64 == 0, (i.filename, start)
        assert data[start:start + i.file_size] == z.read(i)
