"""The substrate that knows no drone: rows with named fields, and functions compiled with Numba.

A *row* is a record with named fields: an object in Python, and a piece of memory in compiled code.
A *rule* is a plain function over rows, which Python runs as it stands and Numba compiles. The other
packages use these names:

- ``rows``: ``row`` and ``Row`` declare a record; ``Table``, ``BoundedTable``, ``Queue`` and
  ``Maybe`` are kinds of its fields, and ``Int32``, ``Int16`` and ``Fitted`` numbers of few bytes.
  ``blank``, ``fill``, ``named``, ``place``, ``address``, ``bound`` and ``held_by`` make rows, read
  and write them.
- ``packing``: ``packed`` and ``attach`` write rows and their tables into blocks of memory.
- ``views``: ``View``, ``in_memory``, ``array_of``, ``dtype_of``, ``zeros`` and ``records`` read and
  write rows in blocks of memory.
- ``kernels``: ``rule``, ``rare_rule``, ``apart``, ``kernel``, ``maker`` and ``part`` say how a
  function is compiled; ``stands_in_for`` replaces a function in compiled code. ``cache_folder``,
  ``compiled_before`` and ``only_from_disk`` are about the machine code that is kept on disk.
- ``compiled_rows``: ``pointer_to``, ``address_of``, ``call`` and its typed variants call a compiled
  function at an address; ``entries_at``, ``array_at``, ``as_array`` and ``place_of`` reach
  into rows.
  ``compiled_types``, ``compiled_entries`` and ``compiled_queues`` say what fields, tables and
  queues are in compiled code; ``set_half`` writes a number of a queue. ``compiled_registers``:
  copies of rows in registers, and choices without a branch.
- ``components``: dataclasses with a method over rows, whose numbers are a row and whose methods
  are machine code.
- ``code_digest``, ``value_text``: of what machine code on disk depends.
- ``bounds``: errors for indices outside the bounds of tables.
- ``regular_file``: opens files where others may have put something else.

``numba_parts`` holds what is not part of Numba's public interface. This package imports nothing of
the simulator but ``errors``.
"""
