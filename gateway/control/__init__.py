"""The control socket, through which the other commands of this program talk to a running gateway.

- server       one JSON object a line; the verbs are the operations of `operator.operations`
- messages     the JSON objects: questions and answers
- path         the path of the socket
"""
