"""Programming layer of the mechanics: vectors, SIMD lanes, memory, records by reference, compilation."""
