def test_presets_are_listed(cli):
    done = cli("devices")
    assert done.status == 0
    assert "zhao2004: m1 = 5, m2 = 1" in done.out
    words = " ".join(done.out.split())
    assert "tabulated_capacitance.positions = 41 values from -4.95e-06 to 4.95e-06 m," in words
