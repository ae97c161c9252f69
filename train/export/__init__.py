"""Export of trained networks to the deployment files of other projects.

`plain_network` turns a policy bundle into a plain network with a specification of its observation and actions. Each
format has a module that checks and writes it. `export.export` writes a folder and reads it back.
"""
