def test_presets_are_listed(cli):
    done = cli("devices")
    assert done.status == 0
    assert "zhao2004: m1 = 5, m2 = 1" in done.out
