"""What ``detailbench new`` writes, with ``my_plugin`` and ``MyPlugin`` in place of the names: no plugins, no tests."""
