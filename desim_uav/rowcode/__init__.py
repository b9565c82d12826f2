"""The substrate that knows no drone: rows with named fields, and functions compiled with Numba.

A *row* is a record with named fields: an object in Python, and a piece of memory in compiled code.
A *rule* is a plain function over rows, which Python runs as it stands and Numba compiles. The other
packages use these names:

- ``rows``: ``row`` and ``Row`` declare a record; ``Table``, ``BoundedTable``, ``Queue`` and
  ``View`` are kinds of its fields. ``blank``, ``fill``, ``named``, ``attach``, ``packed``,
  ``in_memory``, ``place``, ``address``, ``bound``, ``held_by``, ``array_of``, ``dtype_of``,
  ``zeros`` and ``records`` make rows, read and write them.
- ``kernels``: ``rule``, ``rare_rule``, ``kernel``, ``maker`` and ``part`` say how a function is
  compiled; ``stands_in_for`` replaces a function in compiled code. ``cache_folder`` and
  ``compiled_before`` say where its machine code is kept.
- ``compiled_rows``: ``pointer_to``, ``address_of``, ``call`` and its typed variants call a compiled
  function at an address; ``entries_at``, ``array_at``, ``as_array``, ``place_of`` and ``set_word``
  reach into rows. ``compiled_registers``: copies of rows in registers, and choices without a
  branch.
- ``components``: dataclasses with a method over rows, whose numbers are a row and whose methods
  are machine code.
- ``code_digest``, ``value_text``: of what machine code on disk depends.
- ``bounds``: errors for indices outside the bounds of tables.
- ``regular_file``: opens files where others may have put something else.

``numba_parts`` holds what is not part of Numba's public interface. This package imports nothing of
the simulator but ``errors``.
"""
