"""`python -m measured_materials`: the command line."""

from .addon.cli import main

raise SystemExit(main())
